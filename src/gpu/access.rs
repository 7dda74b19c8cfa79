//! What passes do to resources, and the barriers that follow. Plain data, no Vulkan calls.

use std::collections::HashMap;

use ash::vk;

/// How a step uses a resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Storage read in a compute shader.
    ShaderRead,
    /// Uniform read in a compute shader.
    UniformRead,
    /// Storage write in a compute shader; earlier contents do not matter.
    ShaderWrite,
    /// Storage read and write in a compute shader.
    ShaderUpdate,
    /// Sampled or fetched in a compute shader.
    ShaderSample,
    /// Image texels stored in a compute shader; other texels keep what they hold.
    ShaderStore,
    /// The image gets its layout; what it holds is undefined.
    Prepare,
    /// Source of a copy.
    CopyRead,
    /// Destination of a copy or fill.
    CopyWrite,
    /// Read by the host after the submit's time point.
    HostRead,
}

impl Access {
    /// Whether it changes the resource.
    pub const fn writes(self) -> bool {
        matches!(
            self,
            Access::ShaderWrite
                | Access::ShaderUpdate
                | Access::ShaderStore
                | Access::Prepare
                | Access::CopyWrite
        )
    }

    pub(crate) const fn stage(self) -> vk::PipelineStageFlags2 {
        match self {
            Access::ShaderRead
            | Access::UniformRead
            | Access::ShaderWrite
            | Access::ShaderUpdate
            | Access::ShaderSample
            | Access::ShaderStore => vk::PipelineStageFlags2::COMPUTE_SHADER,
            // A layout is set by a barrier, for which any stage of the role's queue may stand.
            Access::CopyRead | Access::CopyWrite | Access::Prepare => {
                vk::PipelineStageFlags2::ALL_TRANSFER
            }
            Access::HostRead => vk::PipelineStageFlags2::HOST,
        }
    }

    pub(crate) fn mask(self) -> vk::AccessFlags2 {
        match self {
            Access::ShaderRead => vk::AccessFlags2::SHADER_STORAGE_READ,
            Access::UniformRead => vk::AccessFlags2::UNIFORM_READ,
            Access::ShaderWrite | Access::ShaderStore => vk::AccessFlags2::SHADER_STORAGE_WRITE,
            Access::ShaderUpdate => {
                vk::AccessFlags2::SHADER_STORAGE_READ | vk::AccessFlags2::SHADER_STORAGE_WRITE
            }
            Access::ShaderSample => vk::AccessFlags2::SHADER_SAMPLED_READ,
            Access::CopyRead => vk::AccessFlags2::TRANSFER_READ,
            Access::CopyWrite | Access::Prepare => vk::AccessFlags2::TRANSFER_WRITE,
            Access::HostRead => vk::AccessFlags2::HOST_READ,
        }
    }
}

/// Identifies a buffer or image for as long as the device lives.
pub(crate) type ResourceId = u64;

/// One dependency between an earlier use of a resource and the next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Barrier {
    pub(crate) resource: ResourceId,
    /// Stages and accesses that must have ended.
    pub before: (vk::PipelineStageFlags2, vk::AccessFlags2),
    /// Stages and accesses that wait.
    pub after: (vk::PipelineStageFlags2, vk::AccessFlags2),
    /// The image's first use: its contents are undefined and its layout is set.
    pub discard: bool,
}

impl Barrier {
    /// As the recorder makes it between two uses of a resource, for records made by hand.
    pub fn between(before: Access, after: Access) -> Barrier {
        Barrier {
            resource: 0,
            before: (before.stage(), before.mask() & WRITES),
            after: (after.stage(), after.mask()),
            discard: false,
        }
    }
}

/// Remembers the last uses of every resource on one role and says which barriers a use needs.
///
/// Uses on another role are not seen here: they are ordered by time points, whose semaphores order
/// memory too.
#[derive(Debug, Default)]
pub struct Tracker {
    uses: HashMap<ResourceId, LastUses>,
}

#[derive(Clone, Copy, Debug, Default)]
struct LastUses {
    written: (vk::PipelineStageFlags2, vk::AccessFlags2),
    /// Stages and accesses that already see the last write.
    seen: (vk::PipelineStageFlags2, vk::AccessFlags2),
    /// Stages that read since the last write.
    reading: vk::PipelineStageFlags2,
}

impl Tracker {
    /// The barrier, if any, before `access` to a resource, which is then remembered. `fresh` marks
    /// the first use of an image.
    pub(crate) fn use_next(
        &mut self,
        resource: ResourceId,
        access: Access,
        fresh: bool,
    ) -> Option<Barrier> {
        let last = self.uses.entry(resource).or_default();
        let after = (access.stage(), access.mask());
        let barrier = if fresh {
            let before = (vk::PipelineStageFlags2::NONE, vk::AccessFlags2::NONE);
            Some(Barrier { resource, before, after, discard: true })
        } else if access.writes() && !last.reading.is_empty() {
            // Write after read: an execution dependency, which also orders the write before it.
            let before = (last.reading | last.written.0, last.written.1);
            Some(Barrier { resource, before, after, discard: false })
        } else if last.written.0.is_empty()
            || (!access.writes() && last.seen.0.contains(after.0) && last.seen.1.contains(after.1))
        {
            None
        } else {
            Some(Barrier { resource, before: last.written, after, discard: false })
        };
        if access.writes() {
            let written = (after.0, after.1 & WRITES);
            *last = LastUses { written, ..LastUses::default() };
        } else {
            last.reading |= after.0;
            if barrier.is_some() {
                last.seen = (last.seen.0 | after.0, last.seen.1 | after.1);
            }
        }
        barrier
    }

    /// Forgets a resource that no longer exists.
    pub(crate) fn forget(&mut self, resource: ResourceId) {
        self.uses.remove(&resource);
    }
}

/// Accesses that change what is there.
pub(crate) const WRITES: vk::AccessFlags2 = vk::AccessFlags2::from_raw(
    vk::AccessFlags2::SHADER_STORAGE_WRITE.as_raw() | vk::AccessFlags2::TRANSFER_WRITE.as_raw(),
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_read_after_a_write_waits_once() {
        let mut tracker = Tracker::default();
        assert_eq!(tracker.use_next(1, Access::ShaderWrite, false), None);
        let barrier = tracker.use_next(1, Access::ShaderRead, false).expect("read after write");
        assert_eq!(barrier.before.1, vk::AccessFlags2::SHADER_STORAGE_WRITE);
        assert_eq!(tracker.use_next(1, Access::ShaderRead, false), None);
        assert!(tracker.use_next(1, Access::CopyRead, false).is_some(), "another stage waits too");
    }

    #[test]
    fn a_write_waits_for_readers_and_writers() {
        let mut tracker = Tracker::default();
        tracker.use_next(1, Access::ShaderRead, false);
        let barrier = tracker.use_next(1, Access::ShaderWrite, false).expect("write after read");
        assert_eq!(barrier.before.0, vk::PipelineStageFlags2::COMPUTE_SHADER);
        assert!(tracker.use_next(1, Access::ShaderUpdate, false).is_some(), "write after write");
        assert!(tracker.use_next(2, Access::ShaderWrite, false).is_none(), "another resource");
    }

    #[test]
    fn a_fresh_image_discards_what_it_held() {
        let mut tracker = Tracker::default();
        let barrier = tracker.use_next(1, Access::CopyWrite, true).expect("first use");
        assert!(barrier.discard);
        assert!(!tracker.use_next(1, Access::ShaderSample, false).expect("then read").discard);
    }
}
