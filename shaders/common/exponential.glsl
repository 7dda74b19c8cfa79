// exponential.glsl: exp(-x) and 1 - exp(-x) for x >= 0, each to a few units in the last place on every
// device: drivers may take exp within 3 + 2 |x| ulp, and 1 - exp(-x) from it cancels for small x.
// twin: src/twins/exponential.rs

#ifndef EXPONENTIAL_GLSL
#define EXPONENTIAL_GLSL

struct Attenuation {
    float transmitted;  // exp(-x)
    float absorbed;     // 1 - exp(-x)
};

Attenuation attenuate(float x) {
    // x = halvings * ln 2 + rest, |rest| <= ln 2 / 2; ln 2 in two parts, so that the rest is exact.
    float bounded = min(x, 87.0);
    float halvings = floor(bounded * 1.44269504 + 0.5);
    precise float rest = (bounded - halvings * 0.693359375) + halvings * 2.12194440e-4;
    // 1 - exp(-rest): Taylor to degree 8, 3e-9 of the result at the interval's ends.
    float rest_absorbed = 2.48015873e-5;
    rest_absorbed = 1.98412698e-4 - rest * rest_absorbed;
    rest_absorbed = 1.38888889e-3 - rest * rest_absorbed;
    rest_absorbed = 8.33333333e-3 - rest * rest_absorbed;
    rest_absorbed = 4.16666667e-2 - rest * rest_absorbed;
    rest_absorbed = 1.66666667e-1 - rest * rest_absorbed;
    rest_absorbed = 0.5 - rest * rest_absorbed;
    rest_absorbed = rest - rest * rest * rest_absorbed;
    float scale = uintBitsToFloat((127u - uint(halvings)) << 23);
    return Attenuation(scale - scale * rest_absorbed, (1.0 - scale) + scale * rest_absorbed);
}
#endif
