// ranking.glsl: whether a slot may be given up, and how urgent a wish is. twin: src/twins/ranking.rs
//
// binds    slot_used    [slot]  round in which a ray last used it
//          slot_needed  [slot]  round in which a waiting ray last needed it; guarded order alone
// variants SUBSTITUTE: what this round used stays, and so do levels that are held;
//          PAPERS: nothing stays but by use, as in the papers;
//          WEIGHTS: wishes by weight, heaviest first; else by where in the view a ray waits
//
// Includers declare slot_owner, and wish_weight where wishes have weights.

layout(std430) readonly buffer slot_used { uint round_used[]; };
#ifdef SUBSTITUTE
#define RANK_HELD 0u
#elif !defined(PAPERS)
layout(std430) readonly buffer slot_needed { uint round_needed[]; };
#endif

// SLOT_DEAD, SLOT_PROMISED, or the rank at which the slot's brick may still be needed.
uint rank_of_slot(CacheRound cache, uint slot, uint front) {
    uint owner = owner_of_slot[slot];
    if (owner == OWNER_GRANTED) {
        return SLOT_PROMISED;
    }
    if (owner == OWNER_FREE) {
        return SLOT_DEAD;
    }
    uint place = (owner - cache.entry_first) / cache.channels;
#ifdef SUBSTITUTE
    bool held = level_views[level_of_place(place)].held != 0u;
    return held || round_used[slot] == cache.round ? RANK_HELD : SLOT_DEAD;
#elif defined(PAPERS)
    return SLOT_DEAD;
#else
    uint rank = rank_of_place(place);
    // All rays stand at the front or behind it. Who needed a brick at the front has gone through it,
    // unless it waits for another brick of that place.
    bool passed = rank < front || (rank == front && round_needed[slot] != cache.round);
    return rank >= cache.ranks || passed ? SLOT_DEAD : rank;
#endif
}

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
