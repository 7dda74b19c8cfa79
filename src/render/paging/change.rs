//! From one plan of a volume to the next without making everything anew: what must be alike, and of which
//! channels something is forgotten.
//!
//! # Source
//! residency-octree-2023 section 4.1: m of n channels have a page table. Here any of the m places can be
//! another channel's from one round to the next.

use std::sync::Arc;

use crate::error::Result;
use crate::gpu::{ComputePipeline, Gpu, Shader};
use crate::render::paging::brick_numbers::ChannelPlace;
use crate::render::paging::leaf_words::LeafChannel;
use crate::render::paging::paged::Paged;
use crate::render::paging::plan::PagingPlan;
use crate::render::paging::traversal_choice::TraversalChoice;
use crate::residency::AtlasPlan;
use crate::twins::forget::Push;

/// A channel of which something is forgotten.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Changed {
    /// Its place before.
    place: ChannelPlace,
    /// The same voxels as before: bricks that are there stay.
    keep: bool,
}

impl PagingPlan {
    /// Why objects of this plan cannot serve the next; nothing: they can.
    pub fn unlike(&self, next: &PagingPlan) -> Option<&'static str> {
        let places = |plan: &PagingPlan| -> Vec<_> {
            plan.numbers.channels.iter().map(|place| (place.atlas, place.in_atlas)).collect()
        };
        let atlases = |plan: &PagingPlan| -> Vec<_> {
            let of = |atlas: &AtlasPlan| (atlas.layout, atlas.shape);
            plan.residency.atlases.iter().map(of).collect()
        };
        let lists = |plan: &PagingPlan| {
            let of = &plan.residency;
            (of.grants_max, of.requests_max, of.updates_max, plan.staging_half_bytes)
        };
        if places(self) != places(next) {
            return Some("it shows another number of channels, or others of their formats");
        }
        if atlases(self) != atlases(next) || self.residency.entries() != next.residency.entries() {
            return Some("its atlases are others");
        }
        if self.residency.ranks != next.residency.ranks {
            return Some("it refines in another way");
        }
        if self.octree != next.octree || self.other_bricks.is_some() != next.other_bricks.is_some()
        {
            return Some("it crosses what shows nothing in another way");
        }
        if lists(self) != lists(next) || self.copy_path != next.copy_path {
            return Some("its bricks travel in another way");
        }
        let ranks = self.residency.rank_count < next.residency.rank_count;
        ranks.then_some("its bricks have more ranks")
    }

    /// Channels that are not shown any more, and those of which something else shows.
    fn changed(&self, next: &PagingPlan) -> Vec<Changed> {
        let pairs = self.numbers.channels.iter().zip(&next.numbers.channels);
        let changed = |(before, after): (&ChannelPlace, &ChannelPlace)| {
            let [was, is] =
                [(self, before), (next, after)].map(|(plan, place)| &plan.judges[&place.in_source]);
            let keep = before.in_source == after.in_source && was.layout == is.layout;
            (!keep || was != is).then_some(Changed { place: *before, keep })
        };
        pairs.filter_map(changed).collect()
    }

    /// What rays of the residency octree are told of the channels.
    pub fn leaf_channels(&self) -> Vec<LeafChannel> {
        let last = self.views.first().map_or(0, |view| view.levels.len() - 1);
        let channel = |(place, finest): (&ChannelPlace, &u8)| LeafChannel {
            in_source: place.in_source,
            judge: self.judges[&place.in_source].clone(),
            levels: [usize::from(*finest), last],
        };
        self.numbers.channels.iter().zip(&self.finest).map(channel).collect()
    }

    fn push(&self, changed: &Changed) -> Push {
        let Changed { place: ChannelPlace { atlas, in_atlas, .. }, keep } = *changed;
        let plan = &self.residency.atlases[atlas];
        Push {
            entry_first: plan.shape.entry_first,
            channels: plan.shape.channels,
            channel: in_atlas,
            places: plan.entry_count / plan.shape.channels,
            slot_first: plan.shape.slot_first,
            slot_count: plan.layout.slot_count(),
            keep: keep.into(),
            round: 0,
        }
    }
}

impl Paged {
    /// Goes on with the next plan of the same volume, to which this one is not [`PagingPlan::unlike`].
    /// `shaders` are its passes' variants, `forget` is that pass. The device must have ended its rounds.
    ///
    /// A channel that another takes the place of leaves nothing behind: its entries are unmapped and its
    /// slots nobody's before the next round marches, what is on its way to them is dropped, and arrivals
    /// are known by their own channel's number, which has no entry any more.
    ///
    /// # Errors
    /// Exit code 4 when the device is lost or out of memory.
    pub fn change(
        &mut self,
        gpu: &Arc<Gpu>,
        next: PagingPlan,
        shaders: &[Shader],
        forget: &Shader,
    ) -> Result<()> {
        // What failed may have recovered: it is asked for again.
        self.loading.forget_failures();
        self.forget_failures();
        // What is staged goes where it was promised, and no later copy overtakes it.
        self.flush(gpu, None)?;
        if let Some(point) = self.copied_until {
            gpu.wait(point)?;
        }
        let changed = self.plan.changed(&next);
        for channel in &changed {
            self.host.forget_channel(channel.place.in_source, channel.keep);
        }
        // Whoever judges anew asks anew: what came while a channel was not shown was said to nobody.
        for (in_source, judge) in &next.judges {
            if self.plan.judges.get(in_source) != Some(judge) {
                self.loading.forget_surveys(0, *in_source);
            }
        }
        if self.forget.is_none() && !changed.is_empty() {
            self.forget = Some(ComputePipeline::new(gpu, forget.clone())?);
        }
        self.forgotten.extend(changed.iter().map(|channel| self.plan.push(channel)));
        self.host.show(next.numbers.clone(), next.judges.clone(), next.held.clone());
        let remake = |pipeline: &mut Arc<ComputePipeline>, shader: &Shader| -> Result<()> {
            if *pipeline.variant() != shader.variant {
                *pipeline = ComputePipeline::new(gpu, shader.clone())?;
            }
            Ok(())
        };
        remake(&mut self.set_up, &shaders[1])?;
        remake(&mut self.march, &shaders[2])?;
        remake(&mut self.resolve, &shaders[8])?;
        if let Some((march, choice)) = &mut self.other_march {
            remake(march, &shaders[9])?;
            *choice = TraversalChoice::default();
        }
        let same = changed.is_empty() && self.plan.finest == next.finest;
        if let Some((words, _)) = self.octree.as_mut().filter(|_| !same) {
            words.show(next.leaf_channels());
        }
        self.plan = next;
        Ok(())
    }
}
