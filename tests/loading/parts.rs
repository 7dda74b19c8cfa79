//! What loaders say of when they did what, to whoever asks.

use std::sync::Arc;
use std::time::Duration;

use ashfall::error::{Error, Result};
use ashfall::loading::{Block, DoneJob, DoneWork, Loading};
use ashfall::source::{BrickEntry, BrickSource, Computed, Description, FieldSource};
use ashfall::volume::BrickId;

use crate::sources::*;

const PAUSE: Duration = Duration::from_millis(2);

/// Fetches for a while, then decodes for a while; brick 3 cannot be decoded, brick 4 not even fetched.
struct Packed(FieldSource<Computed>);

impl BrickSource for Packed {
    fn description(&self) -> &Description {
        self.0.description()
    }

    fn entry(&self, id: BrickId) -> Result<BrickEntry> {
        self.0.entry(id)
    }

    fn read(&self, id: BrickId, bytes: &mut Vec<u8>) -> Result<()> {
        self.read_telling(id, bytes, &mut || {})
    }

    fn read_telling(
        &self,
        id: BrickId,
        bytes: &mut Vec<u8>,
        fetched: &mut dyn FnMut(),
    ) -> Result<()> {
        std::thread::sleep(PAUSE);
        if id == brick(4) {
            return Err(Error::input("not there"));
        }
        fetched();
        std::thread::sleep(PAUSE);
        if id == brick(3) {
            return Err(Error::input("damaged"));
        }
        self.0.read(id, bytes)
    }
}

/// Parts of the jobs on bricks 0 to 4, by brick; each begins where the one before ends.
fn parts(mut loading: Loading) -> Vec<(u32, Vec<&'static str>)> {
    loading.keep_jobs();
    loading.wish(&wishes(&[(0, 0), (1, 1), (2, 2), (3, 3), (4, 4)]));
    all(&mut loading);
    let (jobs, dropped) = loading.take_jobs();
    assert_eq!(dropped, 0);
    let of = |job: &DoneJob| {
        let DoneWork::Read { id, bytes } = job.work else { panic!("{job:?}") };
        let parts: Vec<_> = job.parts().collect();
        assert_eq!(parts[0].1[0], job.moments.begin);
        assert_eq!(parts[parts.len() - 1].1[1], job.end);
        for pair in parts.windows(2) {
            assert_eq!(pair[0].1[1], pair[1].1[0], "{job:?}");
        }
        for (name, [begin, end]) in &parts {
            let long = *end - *begin >= PAUSE;
            assert!(long || *name == "inspect", "{name} of {id}: {:?}", *end - *begin);
        }
        assert_eq!(bytes.is_some(), id.x + 4 * id.y < 3, "{job:?}");
        (id.x + 4 * id.y, parts.iter().map(|(name, _)| *name).collect())
    };
    let mut parts: Vec<_> = jobs.iter().map(of).collect();
    parts.sort();
    parts
}

#[test]
fn fetching_decoding_and_inspecting_follow_each_other() {
    let limits = || ashfall::loading::LoadingLimits { attempts: 1, ..limits(2) };
    let source = || Arc::new(Packed(volume("shells")));
    let plain = parts(Loading::new(vec![source()], limits()).unwrap());
    let both = vec!["read", "decode"];
    let failed = [(3, both.clone()), (4, vec!["read"])];
    let expected: Vec<_> =
        (0..3).map(|brick| (brick, both.clone())).chain(failed.clone()).collect();
    assert_eq!(plain, expected, "what failed has the parts it came to");
    let inspect = Arc::new(|_: BrickId, _: &[u8]| Vec::new());
    let seen = parts(Loading::inspecting(vec![source()], limits(), inspect).unwrap());
    let three = vec!["read", "decode", "inspect"];
    let expected: Vec<_> = (0..3).map(|brick| (brick, three.clone())).chain(failed).collect();
    assert_eq!(seen, expected);
}

#[test]
fn a_source_that_does_not_tell_has_one_part() {
    let source = faulty("shells", ashfall::source::faulty::Slow(PAUSE));
    let mut loading = loading(&source, limits(1));
    loading.keep_jobs();
    loading.survey(&[Block::of(brick(0))]);
    loading.wish(&wishes(&[(0, 0)]));
    all(&mut loading);
    let names: Vec<Vec<_>> = loading
        .take_jobs()
        .0
        .iter()
        .map(|job| job.parts().map(|(name, _)| name).collect())
        .collect();
    assert_eq!(names, [["survey"], ["read"]]);
}

#[test]
fn nobody_is_told_who_does_not_ask() {
    let source = faulty("shells", ashfall::source::faulty::Slow(Duration::ZERO));
    let mut loading = loading(&source, limits(1));
    loading.wish(&wishes(&[(0, 0)]));
    all(&mut loading);
    assert_eq!(loading.take_jobs(), (Vec::new(), 0));
    // From then on.
    loading.keep_jobs();
    loading.wish(&wishes(&[(1, 0)]));
    all(&mut loading);
    assert_eq!(loading.take_jobs().0.len(), 1);
}
