//! Flows: one brick's way through the tracks, from being asked for to being given up.
//!
//! A viewer of the file draws them as arrows. A way begins where the brick is wanted, or read ahead, goes through
//! what loaders do with it, its staging and its copy, and is finished once it was published; when it was sampled first and
//! evicted follows, where that came about.

use std::collections::{BTreeMap, HashMap};

use crate::gpu::RoleKind;
use crate::trace::event::{BrickStep, Details, Event, Span, Track};
use crate::volume::BrickId;

/// One brick's way, once.
#[derive(Clone, Debug, PartialEq)]
pub struct Flow {
    /// Whose.
    pub brick: BrickId,
    /// Where it passed, what happened there, and when, in order.
    pub places: Vec<(Track, &'static str, i64)>,
    /// It came to its slot.
    pub finished: bool,
}

/// The ways of all bricks among `events`. `tracks`: their spans as they will be drawn.
pub fn flows<'e>(
    events: impl Iterator<Item = &'e Event>,
    tracks: &BTreeMap<Track, Vec<Span>>,
) -> Vec<Flow> {
    let copies: HashMap<u64, (&str, i64)> = tracks
        .get(&Track::Queue(RoleKind::Transfer))
        .into_iter()
        .flatten()
        .rev()
        .filter_map(|span| match span.details {
            Details::Copy { time_point, .. } => Some((time_point, (span.name, span.begin_ns))),
            _ => None,
        })
        .collect();
    let mut open: HashMap<BrickId, Flow> = HashMap::new();
    let mut done = Vec::new();
    for event in events {
        let (id, place, step) = match *event {
            Event::Span(Span {
                track: track @ Track::Loader(_), name, details, begin_ns, ..
            }) => {
                let Details::Brick(id, Some(_)) = details else { continue };
                (id, (track, name, begin_ns), None)
            }
            Event::Brick { id, step, at_ns } => (id, (Track::Host, step.name(), at_ns), Some(step)),
            Event::Span(_) | Event::Count { .. } => continue,
        };
        let begins = matches!(step, None | Some(BrickStep::Wanted));
        if begins && open.get(&id).is_some_and(|flow| flow.finished) {
            done.extend(open.remove(&id));
        }
        // What happens to a brick whose way began before the first event kept has no flow.
        if !begins && step != Some(BrickStep::Staged) && !open.contains_key(&id) {
            continue;
        }
        let new = || Flow { brick: id, places: Vec::new(), finished: false };
        let flow = open.entry(id).or_insert_with(new);
        match step {
            Some(BrickStep::Submitted { time_point, .. }) => {
                // A queue without timestamps has no place for it.
                let copy = copies.get(&time_point);
                let queue = Track::Queue(RoleKind::Transfer);
                flow.places.extend(copy.map(|(name, begin_ns)| (queue, *name, *begin_ns)));
            }
            _ => flow.places.push(place),
        }
        flow.finished |= matches!(step, Some(BrickStep::Published(_)));
        if matches!(step, Some(BrickStep::Evicted(_))) {
            done.extend(open.remove(&id));
        }
    }
    let mut rest: Vec<(BrickId, Flow)> = open.into_iter().collect();
    rest.sort_by_key(|(id, _)| *id);
    done.extend(rest.into_iter().map(|(_, flow)| flow));
    done.iter_mut().for_each(|flow| flow.places.sort_by_key(|(_, _, at_ns)| *at_ns));
    done
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_brick_that_comes_twice_has_two_ways() {
        let id = |x| BrickId { volume: 0, channel: 0, level: 0, x, y: 0, z: 0 };
        let brick = |x, step, at_ns| Event::Brick { id: id(x), step, at_ns };
        let [read, decode] =
            [("read", 20, 25), ("decode", 25, 30)].map(|(name, begin_ns, end_ns)| {
                let details = Details::Brick(id(1), Some(8));
                Event::Span(Span { track: Track::Loader(1), name, begin_ns, end_ns, details })
            });
        let copy = Span {
            track: Track::Queue(RoleKind::Transfer),
            name: "copy",
            begin_ns: 50,
            end_ns: 60,
            details: Details::Copy { time_point: 7, bricks: 1, bytes: 8 },
        };
        let tracks = BTreeMap::from([(copy.track, vec![copy])]);
        let submitted = |time_point| BrickStep::Submitted { time_point, bytes: 8 };
        let events = [
            brick(1, BrickStep::Wanted, 10),
            brick(2, BrickStep::Wanted, 11),
            read,
            decode,
            brick(1, BrickStep::Staged, 40),
            brick(1, submitted(7), 45),
            brick(1, BrickStep::Published(3), 70),
            brick(1, BrickStep::Evicted(4), 80),
            brick(1, BrickStep::Wanted, 90),
            brick(1, BrickStep::Staged, 95),
            brick(1, submitted(9), 96),
            brick(1, BrickStep::Published(5), 97),
            brick(3, BrickStep::Sampled(5), 98),
        ];
        let flows = flows(events.iter(), &tracks);
        let (host, loader, queue) =
            (Track::Host, Track::Loader(1), Track::Queue(RoleKind::Transfer));
        let first = vec![
            (host, "wanted", 10),
            (loader, "read", 20),
            (loader, "decode", 25),
            (host, "staged", 40),
            (queue, "copy", 50),
            (host, "published", 70),
            (host, "evicted", 80),
        ];
        assert_eq!(flows[0], Flow { brick: id(1), places: first, finished: true });
        let again = vec![(host, "wanted", 90), (host, "staged", 95), (host, "published", 97)];
        assert_eq!(flows[1], Flow { brick: id(1), places: again, finished: true });
        let asked = vec![(host, "wanted", 11)];
        assert_eq!(flows[2], Flow { brick: id(2), places: asked, finished: false });
        assert_eq!(flows.len(), 3);
    }
}
