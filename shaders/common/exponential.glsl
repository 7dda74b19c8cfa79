// exponential.glsl: exp(-x) and 1 - exp(-x) for x >= 0, each to a few units in the last place on every
// device: drivers may take exp within 3 + 2 |x| ulp, and 1 - exp(-x) from it cancels for small x.
// twin: src/twins/exponential.rs

#ifndef EXPONENTIAL_GLSL
#define EXPONENTIAL_GLSL

struct Attenuation {
    float transmitted;  // exp(-x)
    float absorbed;     // 1 - exp(-x)
};

// For x within 0 and OPAQUE_DEPTH.
Attenuation attenuate_bounded(float x) {
    // x = halvings * ln 2 + rest, |rest| <= ln 2 / 2; ln 2 in two parts, so that the rest is exact.
    int halvings = int(x * 1.44269504 + 0.5);
    float counted = float(halvings);
    float rest = (x - counted * 0.693359375) + counted * 2.12194440e-4;
    // (1 - exp(-rest)) / rest: minimax polynomial, relative error 1.1e-8 on that interval.
    float slope = -1.38888694e-3;
    slope = slope * rest + 8.36910494e-3;
    slope = slope * rest - 4.16671373e-2;
    slope = slope * rest + 1.66665062e-1;
    slope = slope * rest - 0.49999997;
    slope = slope * rest + 1.0;
    float rest_absorbed = rest * slope;
    float scale = intBitsToFloat((127 - halvings) << 23);
    return Attenuation(scale - scale * rest_absorbed, (1.0 - scale) + scale * rest_absorbed);
}

Attenuation attenuate(float x) {
    return attenuate_bounded(min(x, OPAQUE_DEPTH));
}
#endif
