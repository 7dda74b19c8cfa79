//! Linear light as the 8 bit codes that a PNG holds.

/// The nearest sRGB code of a linear component, 0 to 1; what is beyond is clamped, NaN is 0.
///
/// # Source
/// IEC 61966-2-1.
pub fn srgb_byte(linear: f32) -> u8 {
    let linear = f64::from(linear).clamp(0.0, 1.0);
    let encoded =
        if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}
