// progress.glsl: how far the rays of a round have come. twin: src/twins/cache.rs

struct Progress {
    uint front;     // least rank at which a ray waits or stands; RANK_NONE: every ray has ended
    uint waiting;   // rays that wait for a brick; in substitute refinement: that took a coarser one
    uint running;   // rays that used up the round's steps
    uint moved;      // rays that did not wait all the round, once per dispatch
};
