//! Sources, wishes and answers that the tests of loading share.

use std::sync::Arc;
use std::time::Duration;

use ashfall::error::Error;
use ashfall::loading::{Delivery, Loading, LoadingLimits, Wish};
use ashfall::source::faulty::{Fault, Faulty};
use ashfall::source::{BrickSource, Computed, FieldSource, computed};
use ashfall::volume::{BrickId, Size3, WorldFromVoxel};

/// Longer than anything takes: a bound of failure, never waited for when all is well.
pub const LONG: Duration = Duration::from_secs(60);

/// Payload 8, 4 x 4 x 4 bricks in level 0, 2 x 2 x 2 in level 1, one in level 2.
pub fn volume(kind: &str) -> FieldSource<Computed> {
    let size = Size3::cube(32);
    let world = WorldFromVoxel::from_spacing([1.0; 3]).unwrap();
    FieldSource::new(kind, computed(kind, size).unwrap(), size, Size3::cube(8), world)
}

pub fn faulty<F: Fault>(kind: &str, fault: F) -> Arc<Faulty<FieldSource<Computed>, F>> {
    Arc::new(Faulty::new(volume(kind), fault))
}

/// Brick `number` of level 0, x fastest.
pub fn brick(number: u32) -> BrickId {
    let [x, y, z] = [number % 4, number / 4 % 4, number / 16];
    BrickId { volume: 0, channel: 0, level: 0, x, y, z }
}

/// Of one byte a voxel, all of the same size: payload and apron.
pub const BRICK_BYTES: u64 = 10 * 10 * 10;

pub fn wishes(of: &[(u32, u64)]) -> Vec<Wish> {
    of.iter().map(|&(number, rank)| Wish { id: brick(number), rank }).collect()
}

pub fn limits(loaders: usize) -> LoadingLimits {
    let retry_after = Duration::from_millis(1);
    LoadingLimits { loaders, retry_after, ram_bytes: 1 << 20, ..LoadingLimits::default() }
}

pub fn loading(source: &Arc<impl BrickSource + 'static>, limits: LoadingLimits) -> Loading {
    Loading::new(vec![source.clone()], limits).unwrap()
}

/// Takes everything there is.
pub fn all(loading: &mut Loading) -> Vec<Delivery> {
    let deliveries = std::iter::from_fn(|| loading.next(LONG)).collect();
    assert_eq!(loading.outstanding(), 0, "a wait of {LONG:?} was not enough");
    deliveries
}

pub fn ids(deliveries: &[Delivery]) -> Vec<BrickId> {
    let id = |delivery: &Delivery| match delivery {
        Delivery::Brick { id, .. } | Delivery::Failed { id, .. } => Some(*id),
        Delivery::Surveyed { .. } => None,
    };
    deliveries.iter().filter_map(id).collect()
}

pub fn bricks(numbers: &[u32]) -> Vec<BrickId> {
    numbers.iter().map(|&number| brick(number)).collect()
}

/// Each has the bytes that the source gives by itself.
pub fn assert_true_to(source: &dyn BrickSource, deliveries: &[Delivery]) {
    let mut truth = Vec::new();
    for delivery in deliveries {
        if let Delivery::Brick { id, bytes, .. } = delivery {
            source.read(*id, &mut truth).unwrap();
            assert!(truth[..] == bytes[..], "{id}");
        }
    }
}

/// Those that failed, and why.
pub fn failures(deliveries: &[Delivery]) -> Vec<(BrickId, &Error)> {
    let failure = |delivery| match delivery {
        &Delivery::Failed { id, ref why } => Some((id, why)),
        _ => None,
    };
    deliveries.iter().filter_map(failure).collect()
}
