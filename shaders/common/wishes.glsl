// wishes.glsl: the rank of a wish. twin: src/twins/cache.rs
//
// variants WEIGHTS: by weight, heaviest first; else by where in the view a ray waits
//
// Includers declare wish_weight where wishes have weights.

// `entry` counts from the atlas's first.
uint rank_of_wish(CacheRound cache, uint entry) {
#ifdef WEIGHTS
    uint weight = max(weight_of_entry[cache.entry_first + entry], 1u);
    uint doublings = uint(findMSB(weight));
    // The two bits after the leading one.
    uint quarter = (doublings >= 2u ? weight >> (doublings - 2u) : weight << (2u - doublings)) & 3u;
    return WEIGHT_RANKS - 1u - (doublings * 4u + quarter);
#else
    return rank_of_place(entry / cache.channels);
#endif
}
