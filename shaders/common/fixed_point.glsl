// fixed_point.glsl: positions as cell + fraction / 2^32, so that a volume of any size keeps the same
// precision everywhere. twin: src/twins/fixed_point.rs

struct Fixed3 {
    ivec3 cell;
    uvec3 fraction;
};

// start + count * delta, exactly, modulo 2^32 cells.
Fixed3 fixed_advance(Fixed3 start, Fixed3 delta, uint count) {
    uvec3 product_high, product_low;
    umulExtended(uvec3(count), delta.fraction, product_high, product_low);
    uvec3 carry;
    uvec3 fraction = uaddCarry(start.fraction, product_low, carry);
    ivec3 cell = start.cell + ivec3(product_high) + int(count) * delta.cell + ivec3(carry);
    return Fixed3(cell, fraction);
}

// A fraction in 0 to 1; 1 itself can be reached by rounding.
vec3 fixed_fraction(uvec3 fraction) {
    return vec3(fraction) * 2.3283064365386963e-10;
}

// A signed number, rounded once: small negative numbers do not lose digits to the cell of -1.
vec3 fixed_float(Fixed3 value) {
    bvec3 negative = lessThan(value.cell, ivec3(0));
    uvec3 flipped = uvec3(0u) - value.fraction;
    ivec3 flipped_cell = -value.cell - ivec3(notEqual(value.fraction, uvec3(0u)));
    uvec3 fraction = mix(value.fraction, flipped, negative);
    ivec3 cell = mix(value.cell, flipped_cell, negative);
    vec3 magnitude = vec3(cell) + fixed_fraction(fraction);
    return mix(magnitude, -magnitude, negative);
}
