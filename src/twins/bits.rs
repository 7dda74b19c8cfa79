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

/// Samples that a channel takes which takes one of `every`, a power of two up to 16: in turn the one behind the
/// middle of so many and the one before it, so that both together stand for their middle.
pub fn samples_of(every: u32) -> u32 {
    let taken = |at: &u32| {
        let behind = every == 1 || (at / every).is_multiple_of(2);
        at % every == if behind { every / 2 } else { every / 2 - 1 }
    };
    (0..32).filter(taken).fold(0, |bits, at| bits | 1 << at)
}

/// Those that it takes of a block of `samples`: of the last, where fewer than `every` are left, each.
pub fn samples_taken_of(every: u32, samples: u32) -> u32 {
    samples_of(every) | bits_between(samples & !(every - 1), 32)
}
