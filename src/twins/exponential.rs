//! exp(-x) and 1 - exp(-x) for x >= 0; twin of `shaders/common/exponential.glsl`.

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attenuation {
    /// exp(-x)
    pub transmitted: f32,
    /// 1 - exp(-x)
    pub absorbed: f32,
}

/// Attenuation over an optical depth of `x`.
#[allow(clippy::excessive_precision, clippy::approx_constant, reason = "the shader's own digits")]
pub fn attenuate(x: f32) -> Attenuation {
    let bounded = x.min(87.0);
    let halvings = (bounded * 1.442_695_04 + 0.5).floor();
    let rest = (bounded - halvings * 0.693_359_375) + halvings * 2.121_944_40e-4;
    let mut rest_absorbed = 2.480_158_73e-5;
    for coefficient in
        [1.984_126_98e-4, 1.388_888_89e-3, 8.333_333_33e-3, 4.166_666_67e-2, 1.666_666_67e-1, 0.5]
    {
        rest_absorbed = coefficient - rest * rest_absorbed;
    }
    rest_absorbed = rest - rest * rest * rest_absorbed;
    let scale = f32::from_bits((127 - halvings as u32) << 23);
    Attenuation {
        transmitted: scale - scale * rest_absorbed,
        absorbed: (1.0 - scale) + scale * rest_absorbed,
    }
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
