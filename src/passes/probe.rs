//! Samples of one image along straight lines: the price of a sample, and how precise a sampler is.

use crate::gpu::{Buffer, ComputePipeline, Image, Recorder, Sampler, Variant};
use crate::passes::march_shape::FilterShape;
use crate::twins::probe::Push;

/// What one sample of the probe does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProbeShape {
    /// Position arithmetic alone.
    Loop,
    /// One texel, unfiltered.
    OneTexel,
    /// A filtered value.
    Filtered(FilterShape),
}

/// The variant of a shape.
pub fn variant(shape: ProbeShape) -> Variant {
    let define = match shape {
        ProbeShape::Loop => "FILTER_NONE",
        ProbeShape::OneTexel => "FILTER_ONE",
        ProbeShape::Filtered(filter) => filter.define(),
    };
    Variant::plain("probe").define(define, 1)
}

/// Sums the samples of every line; `probed` is left out by the bare loop.
pub fn record<'r>(
    recorder: &mut Recorder<'r>,
    pipeline: &'r ComputePipeline,
    probed: Option<(&'r Image, &'r Sampler)>,
    sums: &'r Buffer,
    push: &Push,
) {
    let mut dispatch = recorder.compute(pipeline).write("sums", sums);
    if let Some(probed) = probed {
        dispatch = dispatch.sample("probed", &[probed]);
    }
    dispatch.push(push).threads([push.lines_across, push.lines_down, 1]);
    recorder.host_read(sums);
}
