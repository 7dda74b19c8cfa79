//! exp(-x) and 1 - exp(-x) for x >= 0; twin of `shaders/common/exponential.glsl`.

use crate::twins::limits::OPAQUE_DEPTH;

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attenuation {
    /// exp(-x)
    pub transmitted: f32,
    /// 1 - exp(-x)
    pub absorbed: f32,
}

/// Attenuation over an optical depth of `x`, at most [`OPAQUE_DEPTH`].
#[allow(clippy::excessive_precision, clippy::approx_constant, reason = "the shader's own digits")]
pub fn attenuate_bounded(x: f32) -> Attenuation {
    let halvings = (x * 1.442_695_04 + 0.5) as i32;
    let counted = halvings as f32;
    let rest = (x - counted * 0.693_359_375) + counted * 2.121_944_40e-4;
    let mut slope = -1.388_886_94e-3f32;
    for coefficient in [8.369_104_94e-3, -4.166_713_73e-2, 1.666_650_62e-1, -0.499_999_97, 1.0] {
        slope = slope * rest + coefficient;
    }
    let rest_absorbed = rest * slope;
    let scale = f32::from_bits(((127 - halvings) << 23) as u32);
    Attenuation {
        transmitted: scale - scale * rest_absorbed,
        absorbed: (1.0 - scale) + scale * rest_absorbed,
    }
}

/// Attenuation over any optical depth.
pub fn attenuate(x: f32) -> Attenuation {
    attenuate_bounded(x.min(OPAQUE_DEPTH))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_are_precise_from_denormal_to_opaque() {
        let mut x = 1e-38f32;
        while x < 85.0 {
            let got = attenuate(x);
            let exact = f64::from(x);
            let transmitted = (-exact).exp();
            let absorbed = -(-exact).exp_m1();
            let error_t = (f64::from(got.transmitted) - transmitted).abs() / transmitted;
            let error_a = (f64::from(got.absorbed) - absorbed).abs() / absorbed;
            assert!(error_t < 3e-7 && error_a < 3e-7, "{x}: {error_t:e}, {error_a:e}");
            x *= 1.001;
        }
        assert_eq!(attenuate(0.0), Attenuation { transmitted: 1.0, absorbed: 0.0 });
        assert_eq!(attenuate(f32::INFINITY).absorbed, 1.0);
    }
}
