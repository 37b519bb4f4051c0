% Reference for ToR-ORd and ToR-ORd-Land: `tor_ord.json`, beside this script. GNU Octave runs the authors' own programs.
%
%   git clone https://github.com/jtmff/torord base
%   git clone https://github.com/MaxxHolmes/Sex_Specific_Human_Electromechanics land
%   sed -i 's/\bdo\b/d_o/g' base/matlab/model_Torord.m land/model_ToRORd_Land.m    # `do` is a keyword of Octave
%   octave --no-gui -q tor_ord.m
%
% Made with Octave 7.3.0, base at commit 11e463d and land at commit eff070f. The programs are under the GPL 3 and are not part
% of this repository; the file holds numbers that they computed. Each case begins one beat after the authors' starting state,
% and records its last beat. Units: ms, mV, mM.
1;
warning('off', 'all');

function X = beat(model, cell_type, factors, outside, cycle_ms, X0, times_ms)
  % One beat from X0, stopped at the end of the stimulus of 1 ms; rows at `times_ms`, which contain 0, 1 and the cycle's end.
  f = @(t, X) model(t, X, 1, cell_type, factors(1), factors(2), factors(3), factors(4), factors(5), factors(6), ...
    factors(7), factors(8), factors(9), factors(10), factors(11), factors(12), factors(13), factors(14), factors(15), ...
    factors(16), factors(17), outside(1), outside(2), outside(3), 0.8, 0.35, -53, 1, [], [], []);
  after = @(t, X) f(t + 10, X);
  options = odeset('RelTol', 1e-6, 'AbsTol', 1e-9, 'MaxStep', 5);
  early = times_ms(times_ms <= 1);
  [~, A] = ode15s(f, early, X0, options);
  if numel(early) == 2
    A = A([1 end], :);
  end
  [~, B] = ode15s(after, times_ms(times_ms >= 1), A(end, :), options);
  X = [A; B(2:end, :)];
end

% Order of the factors: ICaL INa Ito INaL IKr IKs IK1 IKb INaCa INaK INab ICab IpCa IClCa IClb Jrel Jup.
ones17 = ones(1, 17);
moved = [0.9 1.1 1.2 1.5 0.7 1.3 0.85 1.4 0.8 1.15 0.6 1.3 0.75 1.25 0.8 0.9 1.2];
usual = [140 1.8 5];
% name, with Land, cell type, cycle, beats, factors, [Na]o [Ca]o [K]o
cases = {
  'base-endo', false, 0, 1000, 2, ones17, usual;
  'base-epi', false, 1, 1000, 2, ones17, usual;
  'base-mid', false, 2, 1000, 2, ones17, usual;
  'land-endo', true, 0, 1000, 2, ones17, usual;
  'land-epi', true, 1, 1000, 2, ones17, usual;
  'land-mid', true, 2, 1000, 2, ones17, usual;
  'land-moved', true, 0, 600, 3, moved, [142 2.0 4.6];
};
types = {'endo', 'epi', 'mid'};
document = struct('cases', {{}});
for k = 1:rows(cases)
  [name, with_land, cell_type, cycle_ms, n_beats, factors, outside] = cases{k, :};
  if with_land
    folder = 'land';
    start = ['m_' types{cell_type + 1}];
  else
    folder = 'base/matlab';
    start = ['Torord_' types{cell_type + 1}];
  end
  addpath(folder);
  if with_land
    model = @model_ToRORd_Land;
  else
    model = @model_Torord;
  end
  X0 = getStartingState(start)(:)';
  times = unique([0:1:10, 12:2:40, 45:5:100, 110:10:400, 420:20:cycle_ms]);
  first = beat(model, cell_type, factors, outside, cycle_ms, X0, times)(end, :);
  X = first;
  for n = 1:n_beats
    X = beat(model, cell_type, factors, outside, cycle_ms, X(end, :), times);
    printf('%s beat %d: Vmax %.3f Cai max %.6g\n', name, n, max(X(:, 1)), max(X(:, 6)));
    fflush(stdout);
  end
  record = struct('name', name, 'with_land', with_land, 'cell_type', types{cell_type + 1}, 'cycle_ms', cycle_ms, ...
    'n_beats', n_beats, 'factors', factors, 'outside_mM', outside, 'start', first, 'end', X(end, :), ...
    'time_ms', times, 'V_mV', X(:, 1)', 'Ca_i_mM', X(:, 6)', 'Ca_ss_mM', X(:, 7)', 'Ca_jsr_mM', X(:, 9)');
  if with_land
    record.CaTRPN = X(:, 46)';
    record.S = X(:, 44)';
  end
  document.cases{end + 1} = record;
  rmpath(folder);
end
out = fopen('tor_ord.json', 'w');
text = jsonencode(document);
text = strrep(text, '},{', sprintf('},\n{'));
fputs(out, [text sprintf('\n')]);
fclose(out);
