//! From what each chunk adds to where each chunk begins; twin of `shaders/scan.comp`.

use crate::twins::cache::{Answer, CacheRound, ChunkCounts};

/// Sums over all chunks before each, and one more at the end: all. The answer learns how many requests
/// are listed.
pub fn scan(counts: &[ChunkCounts], shape: &CacheRound, answer: &mut Answer) -> Vec<ChunkCounts> {
    let mut before = ChunkCounts::default();
    let mut scanned = vec![before];
    for chunk in counts {
        before = ChunkCounts {
            unused: before.unused + chunk.unused,
            dead_unused: before.dead_unused + chunk.dead_unused,
            dead_used: before.dead_used + chunk.dead_used,
            above: before.above + chunk.above,
            at: before.at + chunk.at,
            requests: before.requests + chunk.requests,
            unused_0: 0,
            unused_1: 0,
        };
        scanned.push(before);
    }
    answer.requests = before.requests.min(shape.requests_max);
    scanned
}
