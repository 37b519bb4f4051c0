//! Indices and ranking from samples. The module only computes statistics and simulates nothing.

use cardiotwin_calibrate::sobol::{
    Analysis, AnalysisSettings, Exclusion, OutputIndices, Ranking, SobolError, analyse,
    replace_excluded,
};
use cardiotwin_schemas::formats;
use cardiotwin_schemas::sensitivity::{
    OutputSensitivity, PairIndices, ParameterIndices, RankedParameter, SensitivityRecord,
};
use cardiotwin_schemas::sweep::GsaSpec;

use super::reference;
use super::samples::Samples;
use crate::SweepError;

/// Indices and ranking of the samples, which may be all blocks or any number of first ones.
///
/// - `threads`: number of biomarkers analysed at once; it does not change the result
///
/// # Errors
/// [`SweepError::TooEarly`] below two blocks, [`SweepError::Sobol`] if no sample is physiological.
pub fn sensitivity(
    spec: &GsaSpec,
    samples: &Samples,
    threads: usize,
) -> Result<SensitivityRecord, SweepError> {
    if samples.n_blocks < 2 {
        return Err(SweepError::TooEarly {
            n_blocks: samples.n_blocks,
            of: spec.n_blocks,
        });
    }
    let names_of_outputs = spec.design.outputs();
    let (values, exclusion) =
        replace_excluded(&samples.values, names_of_outputs.len(), &samples.marks)?;
    let settings = AnalysisSettings {
        n_resamples: spec.analysis.resamples as usize,
        confidence_level: spec.analysis.confidence,
        seed: spec.analysis.seed,
    };
    let analysis = analyse_on(
        [spec.design.parameters.len(), names_of_outputs.len()],
        &values,
        settings,
        threads,
    )?;
    let ranking = Ranking::of(&analysis);
    let names: Vec<&str> = spec
        .design
        .parameters
        .iter()
        .map(|p| p.name.as_str())
        .collect();
    Ok(SensitivityRecord {
        schema_version: formats::SENSITIVITY.version,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        spec: spec.clone(),
        n_blocks: samples.n_blocks,
        samples: samples.counts.clone(),
        arithmetic: samples.arithmetic.clone(),
        outputs: outputs(names_of_outputs, &analysis, &exclusion, &names),
        ranking: ranked(&ranking, &names, spec.design.organ.is_none()),
    })
}

/// [`analyse`] with the biomarkers shared among threads. The indices of a biomarker depend only on
/// its own values.
fn analyse_on(
    [n_parameters, n_outputs]: [usize; 2],
    values: &[f64],
    settings: AnalysisSettings,
    threads: usize,
) -> Result<Analysis, SobolError> {
    let one = |output: usize| {
        let values: Vec<f64> = values
            .iter()
            .skip(output)
            .step_by(n_outputs)
            .copied()
            .collect();
        analyse(n_parameters, 1, &values, settings)
    };
    let threads = threads.clamp(1, n_outputs);
    let mut found: Vec<Option<Result<Analysis, SobolError>>> =
        (0..n_outputs).map(|_| None).collect();
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|first| {
                let one = &one;
                scope.spawn(move || {
                    (first..n_outputs)
                        .step_by(threads)
                        .map(|o| (o, one(o)))
                        .collect::<Vec<_>>()
                })
            })
            .collect();
        for worker in workers {
            for (output, analysis) in worker.join().expect("an analysis does not panic") {
                found[output] = Some(analysis);
            }
        }
    });
    let mut parts = found
        .into_iter()
        .map(|part| part.expect("each biomarker was analysed"));
    let mut whole = parts.next().expect("there are biomarkers")?;
    for part in parts {
        whole.outputs.extend(part?.outputs);
    }
    Ok(whole)
}

fn outputs(
    outputs: &[&str],
    analysis: &Analysis,
    exclusion: &Exclusion,
    names: &[&str],
) -> Vec<OutputSensitivity> {
    let of = |(i, output): (usize, &OutputIndices)| OutputSensitivity {
        name: outputs[i].to_owned(),
        mean: exclusion.means[i],
        standard_deviation: exclusion.standard_deviations[i],
        sum_of_first: output.sum_of_first(),
        parameters: names
            .iter()
            .zip(output.first.iter().zip(&output.total))
            .map(|(name, (first, total))| ParameterIndices {
                name: (*name).to_owned(),
                first: *first,
                total: *total,
            })
            .collect(),
        second: output
            .second
            .iter()
            .map(|pair| PairIndices {
                parameters: pair.parameters.map(|p| names[p].to_owned()),
                second: pair.index,
            })
            .collect(),
    };
    analysis.outputs.iter().enumerate().map(of).collect()
}

/// - `of_cell`: whether the sweep is the cell's, for which alone a reference exists
fn ranked(ranking: &Ranking, names: &[&str], of_cell: bool) -> Vec<RankedParameter> {
    let of = |(rank, ranked): (u32, &cardiotwin_calibrate::sobol::Ranked)| {
        let name = names[ranked.parameter];
        RankedParameter {
            rank,
            name: name.to_owned(),
            sum_of_totals: ranked.sum_of_totals,
            half_width: ranked.half_width,
            rank_interval: ranked
                .rank_interval
                .map(|ranks| ranks.map(|rank| rank as u32)),
            share_among_first_nine: ranked.share_among_first(9),
            reference: reference::rank(name).filter(|_| of_cell),
            paper: reference::paper(name),
        }
    };
    (1..).zip(&ranking.parameters).map(of).collect()
}

#[cfg(test)]
mod tests {
    use cardiotwin_calibrate::sobol::{SaltelliDesign, Sample};

    use super::super::samples::tests::small;
    use super::super::spec::saltelli;
    use super::*;

    /// Biomarkers that are known functions of the two parameters; every tenth row is marked as excluded.
    fn samples(spec: &GsaSpec) -> Samples {
        let design: SaltelliDesign = saltelli(spec).unwrap();
        let rows = design.rows(0..spec.n_blocks as usize);
        let values = rows
            .iter()
            .flat_map(|row| [row[0], row[1], 3.0 * row[0] + row[1], row[0] * row[1], 7.0])
            .collect();
        let mark = |i: usize| {
            if i % 10 == 9 {
                Sample::Excluded
            } else {
                Sample::Physiological
            }
        };
        let marks = (0..rows.len()).map(mark).collect();
        Samples {
            n_blocks: spec.n_blocks,
            values,
            marks,
            ..Samples::default()
        }
    }

    #[test]
    fn shared_among_threads_or_not_the_analysis_is_calibrate_s_own() {
        let mut spec = small(64);
        spec.analysis.resamples = 50;
        let samples = samples(&spec);
        let record = sensitivity(&spec, &samples, 1).unwrap();
        for threads in [2, 3, 16] {
            assert_eq!(
                sensitivity(&spec, &samples, threads).unwrap(),
                record,
                "{threads} threads"
            );
        }
        let (values, exclusion) = replace_excluded(&samples.values, 5, &samples.marks).unwrap();
        let settings = AnalysisSettings {
            n_resamples: 50,
            confidence_level: 0.95,
            seed: 1,
        };
        let whole = analyse(2, 5, &values, settings).unwrap();
        for (output, own) in record.outputs.iter().zip(&whole.outputs) {
            for (parameter, (first, total)) in output
                .parameters
                .iter()
                .zip(own.first.iter().zip(&own.total))
            {
                assert_eq!((parameter.first, parameter.total), (*first, *total));
            }
            assert_eq!(output.second[0].second, own.second[0].index);
        }
        assert_eq!(
            record.outputs[4].parameters[0].total, None,
            "what does not vary has no indices"
        );
        assert_eq!(record.outputs[0].mean, exclusion.means[0]);
        let ranking = Ranking::of(&whole);
        let ranked: Vec<f64> = record.ranking.iter().map(|r| r.sum_of_totals).collect();
        assert_eq!(
            ranked,
            ranking
                .parameters
                .iter()
                .map(|r| r.sum_of_totals)
                .collect::<Vec<_>>()
        );
        assert_eq!((record.ranking[0].rank, record.ranking[1].rank), (1, 2));
    }

    #[test]
    fn too_few_blocks_and_no_physiological_sample_are_said() {
        let spec = small(8);
        let nothing = Samples::default();
        assert!(matches!(
            sensitivity(&spec, &nothing, 1),
            Err(SweepError::TooEarly { n_blocks: 0, of: 8 })
        ));
        let mut none = samples(&spec);
        none.marks.fill(Sample::Excluded);
        assert!(matches!(
            sensitivity(&spec, &none, 1),
            Err(SweepError::Sobol(SobolError::NonePhysiological { .. }))
        ));
    }
}
