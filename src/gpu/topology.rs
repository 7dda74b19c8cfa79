//! Which queues the roles get: a setting, of what the device offers.
//!
//! Copies into images must respect a family's minImageTransferGranularity. Bricks lie at any multiple of their slots
//! and end where the volume does, so a family that copies images in coarser pieces than texels does not get them.

use crate::gpu::device_facts::QueueFacts;
use crate::gpu::roles::RoleKind;

/// How roles map to queues, and whose resources are that both touch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum QueueTopology {
    /// A family of its own for copies where there is one, else a second queue, else the same queue.
    #[default]
    Auto,
    /// Both roles on one queue.
    OneQueue,
    /// Two queues of the family that renders.
    TwoQueues,
    /// A family that only copies, or another one that computes; what both touch is shared concurrently.
    TransferFamily,
    /// The same families; the upload buffer that bricks are placed from belongs to one role at a time, and is handed
    /// over by release and acquire.
    Ownership,
}

impl QueueTopology {
    /// All but auto.
    pub const ALL: [QueueTopology; 4] = [
        QueueTopology::OneQueue,
        QueueTopology::TwoQueues,
        QueueTopology::TransferFamily,
        QueueTopology::Ownership,
    ];

    /// The word in flags and tables.
    pub const fn name(self) -> &'static str {
        match self {
            QueueTopology::Auto => "auto",
            QueueTopology::OneQueue => "one-queue",
            QueueTopology::TwoQueues => "two-queues",
            QueueTopology::TransferFamily => "transfer-family",
            QueueTopology::Ownership => "ownership",
        }
    }

    /// Why a device with these families does not offer it; nothing: it does.
    pub fn lacks(self, queues: &[QueueFacts]) -> Option<&'static str> {
        let Some(render) = render_family(queues) else {
            return Some("it has no queue that runs compute shaders");
        };
        match self {
            QueueTopology::Auto | QueueTopology::OneQueue => None,
            QueueTopology::TwoQueues => {
                (render.count < 2).then_some("the family that renders has one queue")
            }
            QueueTopology::TransferFamily | QueueTopology::Ownership => {
                if transfer_family(queues, render).is_some() {
                    None
                } else if queues.iter().any(copies_only) {
                    Some("the family that only copies does so in coarser pieces than texels")
                } else {
                    Some("it has no other family that copies")
                }
            }
        }
    }

    /// What a device with these families offers.
    pub fn offered(queues: &[QueueFacts]) -> Vec<QueueTopology> {
        QueueTopology::ALL.into_iter().filter(|of| of.lacks(queues).is_none()).collect()
    }

    /// Family and index of each role's queue; nothing where the device does not offer it.
    pub(super) fn assign(self, queues: &[QueueFacts]) -> Option<[(u32, u32); RoleKind::COUNT]> {
        if self.lacks(queues).is_some() {
            return None;
        }
        let render = render_family(queues)?;
        let other = transfer_family(queues, render).map(|queue| (queue.family, 0));
        let second = (render.family, u32::from(render.count > 1));
        let first = (render.family, 0);
        let transfer = match self {
            QueueTopology::Auto => other.unwrap_or(second),
            QueueTopology::OneQueue => first,
            QueueTopology::TwoQueues => second,
            QueueTopology::TransferFamily | QueueTopology::Ownership => other?,
        };
        Some([first, transfer])
    }
}

fn render_family(queues: &[QueueFacts]) -> Option<&QueueFacts> {
    queues
        .iter()
        .filter(|queue| queue.compute && queue.count > 0)
        .max_by_key(|queue| (queue.graphics, std::cmp::Reverse(queue.family)))
}

fn transfer_family<'q>(queues: &'q [QueueFacts], render: &QueueFacts) -> Option<&'q QueueFacts> {
    let copies = queues.iter().find(|queue| copies_only(queue) && queue.copies_texels());
    let computes = || queues.iter().find(|queue| queue.compute && queue.family != render.family);
    copies.or_else(computes)
}

fn copies_only(queue: &QueueFacts) -> bool {
    queue.transfer && !queue.compute && !queue.graphics
}

impl QueueFacts {
    /// Whether it copies any box of an image.
    pub fn copies_texels(&self) -> bool {
        self.copy_granularity == [1, 1, 1]
    }

    /// Whether a copy into this box of an image of `image` texels respects its minImageTransferGranularity.
    pub fn may_copy(&self, start: [u32; 3], size: [u32; 3], image: [u32; 3]) -> bool {
        (0..3).all(|axis| match self.copy_granularity[axis] {
            0 => start[axis] == 0 && size[axis] == image[axis],
            grain => {
                let ends = start[axis].checked_add(size[axis]) == Some(image[axis]);
                start[axis].is_multiple_of(grain) && (ends || size[axis].is_multiple_of(grain))
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use QueueTopology::{Auto, OneQueue, Ownership, TransferFamily, TwoQueues};

    fn family(family: u32, count: u32, compute: bool, graphics: bool) -> QueueFacts {
        QueueFacts {
            family,
            count,
            compute,
            graphics,
            transfer: true,
            timestamp_bits: 64,
            copy_granularity: [1, 1, 1],
        }
    }

    #[test]
    fn copies_get_a_family_of_their_own_where_there_is_one() {
        let both = [family(0, 1, true, true), family(1, 2, false, false)];
        assert_eq!(Auto.assign(&both), Some([(0, 0), (1, 0)]));
        assert_eq!(Auto.assign(&[family(0, 2, true, true)]), Some([(0, 0), (0, 1)]));
        assert_eq!(Auto.assign(&[family(0, 1, true, true)]), Some([(0, 0), (0, 0)]));
        assert_eq!(Auto.assign(&[family(0, 1, false, false)]), None);
    }

    #[test]
    fn a_family_that_copies_coarse_pieces_is_passed_over() {
        for grain in [[0; 3], [16, 16, 8]] {
            let coarse = QueueFacts { copy_granularity: grain, ..family(1, 1, false, false) };
            let queues = [family(0, 1, true, true), coarse];
            assert_eq!(Auto.assign(&queues), Some([(0, 0), (0, 0)]));
            assert_eq!(QueueTopology::offered(&queues), [OneQueue]);
            assert!(TransferFamily.lacks(&queues).expect("coarse").contains("coarser pieces"));
        }
    }

    #[test]
    fn each_topology_is_what_it_says_or_is_not_offered() {
        let [one, two] = [[family(0, 1, true, true)], [family(0, 2, true, true)]];
        assert_eq!(QueueTopology::offered(&one), [OneQueue]);
        assert_eq!(QueueTopology::offered(&two), [OneQueue, TwoQueues]);
        assert_eq!(QueueTopology::offered(&[]), []);
        let all =
            [family(0, 16, true, true), family(1, 2, false, false), family(2, 8, true, false)];
        assert_eq!(QueueTopology::offered(&all), QueueTopology::ALL);
        assert_eq!(OneQueue.assign(&all), Some([(0, 0), (0, 0)]));
        assert_eq!(TwoQueues.assign(&all), Some([(0, 0), (0, 1)]));
        assert_eq!(TransferFamily.assign(&all), Some([(0, 0), (1, 0)]));
        assert_eq!(Ownership.assign(&all), Some([(0, 0), (1, 0)]));
        // Without one that only copies, another that computes.
        assert_eq!(TransferFamily.assign(&[all[0], all[2]]), Some([(0, 0), (2, 0)]));
        assert_eq!(TwoQueues.assign(&one), None);
    }

    #[test]
    fn boxes_respect_the_granularity() {
        let grain =
            |copy_granularity| QueueFacts { copy_granularity, ..family(1, 1, false, false) };
        let image = [64, 64, 20];
        let fine = grain([1, 1, 1]);
        assert!(fine.may_copy([3, 5, 7], [1, 2, 3], image));
        let coarse = grain([16, 16, 8]);
        assert!(coarse.may_copy([16, 0, 8], [16, 32, 8], image));
        assert!(coarse.may_copy([16, 0, 8], [16, 32, 12], image), "up to the image's end");
        assert!(!coarse.may_copy([8, 0, 8], [16, 32, 8], image), "begins between pieces");
        assert!(!coarse.may_copy([16, 0, 0], [16, 32, 12], image), "ends between pieces");
        let whole = grain([0; 3]);
        assert!(whole.may_copy([0; 3], image, image));
        assert!(!whole.may_copy([0; 3], [64, 64, 19], image));
        assert!(!coarse.may_copy([16; 3], [u32::MAX; 3], image));
    }
}
