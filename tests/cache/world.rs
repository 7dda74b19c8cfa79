//! Grids of bricks, atlases that share the cache's buffers, and views that rank bricks.

use crate::random::Random;
pub use crate::views::pick;
use ashfall::twins::cache::{Cache, CacheRound, Ranking};
use ashfall::twins::limits::{ENTRY_UNMAPPED, OWNER_FREE, RANK_NONE, WEIGHT_RANKS};
use ashfall::twins::ranks::LevelView;

/// What a world is made of.
#[derive(Clone, Copy, Debug)]
pub struct Plan {
    /// Bricks of each level.
    pub levels: &'static [[u32; 3]],
    /// Channels and slots of each atlas.
    pub atlases: &'static [(u32, u32)],
    pub substitute: bool,
}

/// A brick of one channel, found from its entry.
#[derive(Clone, Copy, Debug)]
pub struct Brick {
    pub level: usize,
    pub brick: [u32; 3],
}

pub struct World {
    pub plan: Plan,
    /// What stays the same in every round.
    pub atlases: Vec<CacheRound>,
    pub entries: u32,
    pub slots: u32,
    /// Of all entries; nothing between atlases.
    pub bricks: Vec<Option<Brick>>,
    /// More than any view has.
    pub ranks_room: u32,
    pub grants_room: u32,
    pub requests_room: u32,
}

/// Requests of one atlas that the list has room for.
pub const REQUESTS_ROOM: u32 = 96;

/// How one view ranks bricks.
#[derive(Clone, Debug)]
pub struct View {
    pub levels: Vec<LevelView>,
    pub ranks: u32,
}

impl World {
    pub fn new(plan: Plan) -> World {
        let mut places = Vec::new();
        for (level, [nx, ny, nz]) in plan.levels.iter().enumerate() {
            for z in 0..*nz {
                for y in 0..*ny {
                    for x in 0..*nx {
                        places.push(Brick { level, brick: [x, y, z] });
                    }
                }
            }
        }
        let (mut atlases, mut bricks) = (Vec::new(), Vec::new());
        // Slots of one atlas need not stand right behind those of another.
        let (mut slot, mut grant, mut request) = (3, 1, 2);
        for (number, (channels, slots)) in plan.atlases.iter().enumerate() {
            let entry_first = bricks.len() as u32;
            let entries = places.len() as u32 * channels;
            atlases.push(CacheRound {
                slot_first: slot,
                slot_count: *slots,
                entry_first,
                channels: *channels,
                word_first: entry_first / 32,
                word_count: entries.div_ceil(32),
                grant_first: grant,
                request_first: request,
                atlas: number as u32,
                ..CacheRound::default()
            });
            for place in &places {
                bricks.extend((0..*channels).map(|_| Some(*place)));
            }
            bricks.resize(bricks.len().next_multiple_of(1024), None);
            slot += slots + 5;
            grant += slots;
            request += REQUESTS_ROOM;
        }
        let farthest: u32 = plan.levels.iter().map(|bricks| bricks.iter().sum::<u32>()).sum();
        World {
            plan,
            atlases,
            entries: bricks.len() as u32,
            slots: slot,
            bricks,
            ranks_room: farthest.max(WEIGHT_RANKS),
            grants_room: grant,
            requests_room: request,
        }
    }

    /// Every slot free, nothing known.
    pub fn cache(&self) -> Cache {
        let (entries, slots) = (self.entries as usize, self.slots as usize);
        Cache {
            page_table: vec![ENTRY_UNMAPPED; entries],
            slot_owner: vec![OWNER_FREE; slots],
            slot_used: vec![0; slots],
            slot_needed: vec![0; slots],
            usage_order: (0..self.slots).collect(),
            wished: vec![0; entries / 32],
            wish_weight: vec![0; entries],
            touched: vec![0; entries / 32],
            ..Cache::default()
        }
    }

    /// From a brick of the grid, with some levels in use.
    pub fn view(&self, random: &mut Random) -> View {
        let count = self.plan.levels.len();
        let finest = below(random, count as u32) as usize;
        let used = 1 + below(random, (count - finest) as u32) as usize;
        let (mut first_place, mut ranks) = (0, 0);
        let mut levels = Vec::new();
        for (level, bricks) in self.plan.levels.iter().enumerate() {
            let eye = bricks.map(|edge| below(random, edge));
            let in_use = (finest..finest + used).contains(&level);
            levels.push(LevelView {
                bricks: *bricks,
                first_place,
                eye_brick: eye.map(|at| at as i32),
                rank_first: if in_use { ranks } else { RANK_NONE },
                held: u32::from(level + 1 == count),
                ..LevelView::default()
            });
            if in_use {
                let axis = |axis: usize| eye[axis].max(bricks[axis] - 1 - eye[axis]);
                ranks += axis(0) + axis(1) + axis(2) + 1;
            }
            first_place += bricks.iter().product::<u32>();
        }
        View { levels, ranks: if self.plan.substitute { WEIGHT_RANKS } else { ranks } }
    }

    pub fn ranking<'a>(&self, view: &'a View) -> Ranking<'a> {
        Ranking { levels: &view.levels, substitute: self.plan.substitute }
    }

    /// The atlas's push constants of a round, with random bounds.
    pub fn shape(&self, random: &mut Random, atlas: usize, round: u32, view: &View) -> CacheRound {
        let fixed = self.atlases[atlas];
        let slots = fixed.slot_count;
        let grants_max = pick(random, &[0, 1, 2, 1 + slots / 4, slots / 2, slots]);
        CacheRound {
            round,
            ranks: view.ranks,
            grants_max,
            requests_max: pick(random, &[0, 1, 2, 7, 32, REQUESTS_ROOM]),
            live_max: pick(random, &[0, slots / 4, slots / 2, slots * 3 / 4, slots]),
            held: if chance(random, 0.1) { pick(random, &[1, 3, slots / 4]) } else { 0 },
            ..fixed
        }
    }
}

/// A number less than `end`.
pub fn below(random: &mut Random, end: u32) -> u32 {
    (random.unit() * f64::from(end)) as u32
}

pub fn chance(random: &mut Random, of: f64) -> bool {
    random.unit() < of
}

/// A random element, taken out.
pub fn draw<T>(random: &mut Random, from: &mut Vec<T>) -> Option<T> {
    let at = below(random, from.len() as u32) as usize;
    (!from.is_empty()).then(|| from.swap_remove(at))
}
