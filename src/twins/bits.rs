//! Samples of a block as bits of a word; twin of `shaders/common/bits.glsl`.

/// Bits from `from` up to but not `to`.
pub fn bits_between(from: u32, to: u32) -> u32 {
    let below = |end: u32| if end < 32 { (1u32 << end) - 1 } else { u32::MAX };
    below(to) & !below(from)
}

/// The numbers of the bits that are set, least first.
pub fn each_bit(bits: u32) -> impl Iterator<Item = u32> {
    (0..32).filter(move |at| bits >> at & 1 == 1)
}
