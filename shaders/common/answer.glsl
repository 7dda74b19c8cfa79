// answer.glsl: what a round tells the host of one atlas. twin: src/twins/cache.rs

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
