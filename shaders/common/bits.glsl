// bits.glsl: samples of a block as bits of a word. twin: src/twins/bits.rs

// Bits from `from` up to but not `to`.
uint bits_between(uint from, uint to) {
    uint below = to < 32u ? (1u << to) - 1u : 0xffffffffu;
    uint left_out = from < 32u ? (1u << from) - 1u : 0xffffffffu;
    return below & ~left_out;
}
