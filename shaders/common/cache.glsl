// cache.glsl: what the passes that manage an atlas share. twin: src/twins/cache.rs

// One atlas in the buffers that all atlases share, and this round.
struct CacheRound {
    uint round;           // counts from 1
    uint slot_first;
    uint slot_count;
    uint entry_first;     // a place's entries stand together, one per channel of the atlas
    uint channels;
    uint word_first;      // wishes: one bit per entry
    uint word_count;
    uint ranks;           // how many ranks the view has
    uint grants_max;      // that the host can take this round
    uint requests_max;
    uint grant_first;     // in the list of grants
    uint request_first;   // in the list of requests
    uint atlas;
    uint live_max;        // slots that bricks behind the nearest wish may fill
    uint held;            // slots that the host has no brick for: as many wishes need none
};

// Wishes and slots of one atlas, before anything is chosen.
struct Tallies {
    uint dead;            // slots that nobody needs
    uint live;            // slots that some ray may need again
    uint wished;          // wishes
    uint unused_0;
};

struct Choice {
    uint grants;
    uint dead_grants;     // of them from slots that nobody needs
    uint request_cut;     // greatest rank of a request that is listed
    uint victim_cut;      // least rank of a slot that is given up though it may be needed again
};

// Of one chunk of slots or wishes; after scan: of all chunks before it.
struct ChunkCounts {
    uint unused;          // slots not used this round
    uint dead_unused;
    uint dead_used;
    uint above;           // slots whose rank is above victim_cut
    uint at;              // slots whose rank is victim_cut
    uint requests;
    uint unused_0;
    uint unused_1;
};

uint chunks_of_slots(CacheRound cache) {
    return (cache.slot_count + CHUNK_SLOTS - 1u) / CHUNK_SLOTS;
}

uint chunks_of_words(CacheRound cache) {
    return (cache.word_count + CHUNK_WORDS - 1u) / CHUNK_WORDS;
}

// How far the rays of a round have come.
struct Progress {
    uint front;     // least rank at which a ray waits or stands; RANK_NONE: every ray has ended
    uint waiting;   // rays that wait for a brick; in substitute refinement: that took a coarser one
    uint running;   // rays that used up the round's steps
    uint moved;      // rays that did not wait all the round, once per dispatch
};

// What a round tells the host of one atlas.
struct Answer {
    uint wished;        // wishes
    uint first_rank;    // least rank of a wish; RANK_NONE: there is none
    uint first_wishes;  // wishes of that rank
    uint dead;          // slots that nobody needs
    uint live;          // slots that may be needed again
    uint grants;        // slots granted, in the list of grants
    uint requests;      // in the list of requests
    uint touched;       // bricks that rays used for the first time since the list of them was cleared
};
