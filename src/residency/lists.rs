//! The short lists that the host reads after a round.

use crate::error::Result;
use crate::gpu::Buffer;
use crate::passes::cache_buffers::CacheBuffers;
use crate::residency::shape::ResidencyShape;
use crate::twins::cache::{Answer, Progress};

/// What a round tells of one atlas.
#[derive(Clone, Debug, Default)]
pub struct OfAtlas {
    /// Counts.
    pub answer: Answer,
    /// Slots granted; from now on the host's.
    pub grants: Vec<u32>,
    /// Entry and rank of bricks to load, most urgent first; entries of one place stand together.
    pub requests: Vec<[u32; 2]>,
}

/// What a round tells.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Of the rays.
    pub progress: Progress,
    /// Atlas by atlas.
    pub atlases: Vec<OfAtlas>,
    /// Bytes that the host read back for it.
    pub bytes: u64,
}

impl Report {
    pub(super) fn read(
        shape: &ResidencyShape,
        report: &Buffer,
        buffers: &CacheBuffers,
    ) -> Result<Report> {
        let mut progress = Progress::default();
        report.read(0, bytemuck::bytes_of_mut(&mut progress))?;
        let mut answers = vec![Answer::default(); shape.atlases.len()];
        let first = size_of::<Progress>() as u64;
        report.read(first, bytemuck::cast_slice_mut(&mut answers))?;
        let mut atlases = Vec::new();
        let mut bytes = first + size_of_val(&answers[..]) as u64;
        for (number, answer) in answers.into_iter().enumerate() {
            let mut grants = vec![0u32; answer.grants as usize];
            let at = number as u64 * u64::from(shape.grants_max) * 4;
            buffers.grants.read(at, bytemuck::cast_slice_mut(&mut grants))?;
            let mut requests = vec![[0u32; 2]; answer.requests as usize];
            let at = number as u64 * u64::from(shape.requests_max) * 8;
            buffers.requests.read(at, bytemuck::cast_slice_mut(&mut requests))?;
            // By rank; the device lists them in the order of entries, which breaks ties.
            requests.sort_by_key(|[_, rank]| *rank);
            bytes += (size_of_val(&grants[..]) + size_of_val(&requests[..])) as u64;
            atlases.push(OfAtlas { answer, grants, requests });
        }
        Ok(Report { progress, atlases, bytes })
    }
}
