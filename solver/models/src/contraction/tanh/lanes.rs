//! Tanh active stress of many nodes as lanes of SIMD vectors.

use super::equations::{Length, Tanh, tanh_squared};
use crate::contraction::ActiveStress;
use cardiotwin_vector_math::{Lane, exp};
use pulp::{Simd, WithSimd};

/// Nodes that are computed together.
const LANES: usize = 8;

impl Tanh {
    /// As [`Self::stress`] without a branch, in the numbers of vector code. Products are not fused with sums, so that every
    /// processor gives the same bits.
    #[inline(always)]
    fn lane(&self, since_activation_ms: f64, lambda: f64) -> (f64, f64) {
        let p = &self.parameters;
        let ts = since_activation_ms - p.t_emd_ms;
        let (Lane(phi), tau_sr) = self.phi_and_rise(Lane::<false>(lambda));
        let dphi = if phi > 0.0 {
            p.a6 * (1.0 - phi * phi)
        } else {
            0.0
        };
        let (rise, fall) = self.decays(Lane(ts), tau_sr);
        let (Lane(up), Lane(dup)) = tanh_squared(rise);
        let Lane(envelope) = self.envelope(fall);
        let dx = ts / (tau_sr.0 * tau_sr.0) * p.a4_ms * dphi;
        let stress = (envelope * phi * up, envelope * (dphi * up + phi * dup * dx));
        // Both comparisons are made, since a branch would keep the loop from vector code.
        if (ts > 0.0) & (ts < p.t_cr_ms) {
            stress
        } else {
            (0.0, 0.0)
        }
    }
}

/// Nodes with stretches of their own, to be compiled for each instruction set.
pub(super) struct Each<'a> {
    pub(super) tanh: Tanh,
    pub(super) since_activation_ms: &'a [f64],
    pub(super) lambda: &'a [f64],
    pub(super) stress: &'a mut [ActiveStress],
}

impl WithSimd for Each<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { tanh, stress, .. } = self;
        let since = self.since_activation_ms.chunks(LANES);
        for ((since, lambda), out) in since
            .zip(self.lambda.chunks(LANES))
            .zip(stress.chunks_mut(LANES))
        {
            let is_active = |t: &f64| tanh.is_active(t - tanh.parameters.t_emd_ms);
            if !since.iter().any(is_active) {
                out.fill(ActiveStress::default());
                continue;
            }
            let n = out.len();
            let (mut times, mut stretches) = ([0.0; LANES], [1.0; LANES]);
            times[..n].copy_from_slice(since);
            stretches[..n].copy_from_slice(lambda);
            let (mut sa, mut dsa) = ([0.0; LANES], [0.0; LANES]);
            for lane in 0..LANES {
                (sa[lane], dsa[lane]) = tanh.lane(times[lane], stretches[lane]);
            }
            for ((out, sa_kpa), dsa_dlambda_kpa) in out.iter_mut().zip(sa).zip(dsa) {
                *out = ActiveStress {
                    sa_kpa,
                    dsa_dlambda_kpa,
                };
            }
        }
    }
}

/// Active nodes at equal distances in time, oldest first, to be compiled for each instruction set.
///
/// From node to node both exponentials change by a constant factor, so that a vector of nodes needs
/// no exponential of its own. The rise's sequence starts at the youngest node and the fall's at the
/// oldest, where each is largest: they only ever underflow to the right value, zero.
pub(super) struct EquallySpaced<'a> {
    pub(super) tanh: Tanh,
    pub(super) since_activation_ms: &'a [f64],
    pub(super) spacing_ms: f64,
    pub(super) length: &'a Length,
    pub(super) stress: &'a mut [ActiveStress],
}

/// Powers of `q` from 0 to `LANES - 1`, and the next one.
#[inline(always)]
fn powers(q: f64) -> ([f64; LANES], f64) {
    let q2 = q * q;
    let q4 = q2 * q2;
    (
        [1.0, q, q2, q2 * q, q4, q4 * q, q4 * q2, q4 * (q2 * q)],
        q4 * q4,
    )
}

impl WithSimd for EquallySpaced<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self {
            tanh: Tanh { parameters: p },
            since_activation_ms: times,
            spacing_ms: spacing,
            length,
            stress,
        } = self;
        let (oldest, youngest) = (times[0] - p.t_emd_ms, times[times.len() - 1] - p.t_emd_ms);
        let mut exponentials = [
            -2.0 * youngest / length.tau_sr_ms,
            -2.0 * spacing / length.tau_sr_ms,
            -2.0 * (p.t_cr_ms - oldest) / p.tau_sd_ms,
            -2.0 * spacing / p.tau_sd_ms,
        ];
        for exponential in &mut exponentials {
            *exponential = exp::<false>(*exponential);
        }
        let [mut rise, rise_ratio, mut fall, fall_ratio] = exponentials;
        let (fall_powers, fall_next) = powers(fall_ratio);
        for chunk in stress.chunks_mut(LANES) {
            for (out, power) in chunk.iter_mut().zip(fall_powers) {
                out.sa_kpa = fall * power;
            }
            fall *= fall_next;
        }
        let (mut rise_powers, rise_next) = powers(rise_ratio);
        rise_powers.reverse();
        let factor = -length.dtau_sr_ms / (length.tau_sr_ms * length.tau_sr_ms);
        let Length { phi, dphi, .. } = *length;
        for (chunk, times) in stress.rchunks_mut(LANES).zip(times.rchunks(LANES)) {
            // The youngest node is in the last lane.
            let unused = LANES - chunk.len();
            let (mut falls, mut since) = ([0.0; LANES], [0.0; LANES]);
            for (lane, (out, time)) in chunk.iter().zip(times).enumerate() {
                falls[unused + lane] = out.sa_kpa;
                since[unused + lane] = *time;
            }
            let (mut sa, mut dsa) = ([0.0; LANES], [0.0; LANES]);
            for lane in 0..LANES {
                // As `stress`, with one division for both factors.
                let (fall, rise) = (falls[lane], rise * rise_powers[lane]);
                let inverse = 1.0 / ((1.0 + rise) * (1.0 + fall));
                let tanh = (1.0 - rise) * (1.0 + fall) * inverse;
                let tanh_fall = (1.0 - fall) * (1.0 + rise) * inverse;
                let sech = (1.0 + fall) * inverse;
                let envelope = p.smax_ref_kpa * tanh_fall * tanh_fall;
                let (up, dup) = (tanh * tanh, 8.0 * tanh * rise * sech * sech);
                sa[lane] = envelope * phi * up;
                dsa[lane] =
                    envelope * (dphi * up + phi * dup * (since[lane] - p.t_emd_ms) * factor);
            }
            for (lane, out) in chunk.iter_mut().enumerate() {
                *out = ActiveStress {
                    sa_kpa: sa[unused + lane],
                    dsa_dlambda_kpa: dsa[unused + lane],
                };
            }
            rise *= rise_next;
        }
    }
}
