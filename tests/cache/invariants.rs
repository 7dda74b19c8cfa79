//! What must hold of the cache after every round, by plain loops.

use ashfall::twins::cache::{Answer, Cache, CacheRound};
use ashfall::twins::grant::Lists;
use ashfall::twins::limits::{
    ENTRY_MAPPED, ENTRY_PAYLOAD_MASK, ENTRY_STATE_SHIFT, OWNER_FREE, OWNER_GRANTED,
};
use ashfall::twins::ranks::rank_of_place;

use crate::host::Host;
use crate::world::{View, World};

/// Page table, owners and usage order agree with each other and with what the host has in hand.
pub fn holds(cache: &Cache, world: &World, host: &Host) -> Result<(), String> {
    for (atlas, shape) in world.atlases.iter().enumerate() {
        let slots = shape.slot_first as usize..(shape.slot_first + shape.slot_count) as usize;
        let mut entry_of_slot = vec![None; world.slots as usize];
        let entries = shape.entry_first..shape.entry_first + shape.word_count * 32;
        for entry in entries {
            let value = cache.page_table[entry as usize];
            if value >> ENTRY_STATE_SHIFT != ENTRY_MAPPED {
                continue;
            }
            let slot = (shape.slot_first + (value & ENTRY_PAYLOAD_MASK)) as usize;
            if !slots.contains(&slot) {
                return Err(format!("entry {entry} is in slot {slot} of another atlas"));
            }
            if let Some(other) = entry_of_slot[slot].replace(entry) {
                return Err(format!("slot {slot} is mapped by {other} and {entry}"));
            }
        }
        // In the host's hands, each once.
        let mut in_hand = vec![0; world.slots as usize];
        let bound = host.bound.iter().filter(|bound| bound.atlas == atlas).map(|bound| &bound.slot);
        host.hands[atlas].iter().chain(bound).for_each(|slot| in_hand[*slot as usize] += 1);
        for slot in slots.clone() {
            let (owner, entry) = (cache.slot_owner[slot], entry_of_slot[slot]);
            let state = format!("slot {slot}, owner {owner:#x}, mapped by {entry:?}");
            let fits = match owner {
                OWNER_FREE | OWNER_GRANTED => entry.is_none(),
                owner => entry == Some(owner),
            };
            if !fits {
                return Err(format!("{state}: owner and page table differ"));
            }
            if in_hand[slot] != i32::from(owner == OWNER_GRANTED) {
                return Err(format!("{state}: {} times in the host's hands", in_hand[slot]));
            }
        }
        let mut order = cache.usage_order[slots.clone()].to_vec();
        order.sort();
        if order.iter().zip(slots).any(|(got, wanted)| *got as usize != wanted) {
            return Err(format!("the usage order of atlas {atlas} is no permutation"));
        }
    }
    Ok(())
}

/// What waiting rays need, before a round.
pub struct Before {
    /// `[slot]` rank of a brick that a ray may still need.
    needed_at: Vec<Option<u32>>,
}

impl Before {
    pub fn of(cache: &Cache, world: &World, view: &View, shape: &CacheRound) -> Before {
        let mut needed_at = vec![None; world.slots as usize];
        for slot in shape.slot_first..shape.slot_first + shape.slot_count {
            let slot = slot as usize;
            let owner = cache.slot_owner[slot];
            if owner >= OWNER_GRANTED {
                continue;
            }
            if world.plan.substitute {
                let level = world.bricks[owner as usize].expect("a brick").level;
                let stays = view.levels[level].held == 1 || cache.slot_used[slot] == shape.round;
                needed_at[slot] = stays.then_some(0);
                continue;
            }
            let rank = rank_of_place(&view.levels, (owner - shape.entry_first) / shape.channels);
            let front = cache.progress.front;
            let needed = rank > front || cache.slot_needed[slot] == shape.round;
            needed_at[slot] = (rank < view.ranks && rank >= front && needed).then_some(rank);
        }
        Before { needed_at }
    }

    /// A brick that a waiting ray needs is given up only for a brick that is needed nearer.
    pub fn guarded(&self, lists: &Lists, answer: &Answer) -> Result<(), String> {
        let mut given_up = 0;
        for slot in &lists.grants {
            if let Some(rank) = self.needed_at[*slot as usize] {
                given_up += 1;
                if rank <= answer.first_rank {
                    let first = answer.first_rank;
                    return Err(format!("slot {slot} of rank {rank} is granted for rank {first}"));
                }
            }
        }
        if given_up > answer.first_wishes {
            return Err(format!("{given_up} needed slots for {} wishes", answer.first_wishes));
        }
        Ok(())
    }
}
