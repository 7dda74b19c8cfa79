//! Levels of resolution: how each is made from the finer one.

use crate::volume::Size3;

/// One level of a volume.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Voxels along each axis at this level.
    pub size: Size3,
    /// Level-0 voxels that one voxel of this level spans along each axis: a power of two.
    pub scale: [u32; 3],
}

/// All levels of a volume, finest first. The last one is a single brick.
#[derive(Clone, Debug, PartialEq)]
pub struct Levels(Vec<Level>);

impl Levels {
    /// Applies the level rule: level k + 1 halves, rounding up, the axes whose world spacing is at
    /// most sqrt(2) times the smallest spacing of level k and that have more than one voxel, until
    /// the volume is one brick of `payload` voxels per axis.
    ///
    /// # Panics
    /// When the size or the payload is empty: our own bug, since both are checked on input.
    pub fn of(size: Size3, spacing: [f64; 3], payload: Size3) -> Levels {
        assert!(!size.is_empty() && !payload.is_empty(), "levels of an empty volume");
        let payload = payload.to_array();
        let mut levels = vec![Level { size, scale: [1; 3] }];
        loop {
            let finer = levels[levels.len() - 1];
            let size = finer.size.to_array();
            if (0..3).all(|axis| size[axis] <= payload[axis]) {
                return Levels(levels);
            }
            levels.push(coarser(finer, spacing));
        }
    }

    /// Levels as a file lists them, if they could have come from the rule at some spacing: the first
    /// at scale 1, each other with axes kept or halved and some axis halved, the last one brick.
    pub fn from_list(levels: Vec<Level>, payload: Size3) -> Option<Levels> {
        let first = levels.first()?;
        let last = levels.last()?;
        let starts = first.scale == [1; 3] && !first.size.is_empty();
        let one_brick = (0..3).all(|axis| last.size.to_array()[axis] <= payload.to_array()[axis]);
        let steps = levels.windows(2).all(|pair| {
            let [finer, coarser] = [pair[0], pair[1]];
            let [size, next] = [finer.size.to_array(), coarser.size.to_array()];
            let kept = |a: usize| size[a] == next[a] && finer.scale[a] == coarser.scale[a];
            let halved = |a: usize| {
                size[a] > 1
                    && size[a].div_ceil(2) == next[a]
                    && finer.scale[a].checked_mul(2) == Some(coarser.scale[a])
            };
            (0..3).all(|a| kept(a) || halved(a)) && (0..3).any(halved)
        });
        (starts && steps && one_brick).then_some(Levels(levels))
    }

    /// How many there are, at least 1.
    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// The level of that number, 0 finest.
    pub fn get(&self, level: u8) -> Option<Level> {
        self.0.get(usize::from(level)).copied()
    }

    /// Finest first.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Level> + '_ {
        self.0.iter().copied()
    }
}

fn coarser(finer: Level, spacing: [f64; 3]) -> Level {
    let mut size = finer.size.to_array();
    let mut scale = finer.scale;
    let spacing_here = |axis: usize| spacing[axis] * f64::from(finer.scale[axis]);
    // An axis of one voxel cannot be halved, so it must not hold back the others.
    let smallest =
        (0..3).filter(|&axis| size[axis] > 1).map(spacing_here).fold(f64::INFINITY, f64::min);
    for axis in 0..3 {
        let fine = spacing_here(axis) <= smallest * std::f64::consts::SQRT_2;
        if size[axis] > 1 && fine {
            size[axis] = size[axis].div_ceil(2);
            scale[axis] = scale[axis].saturating_mul(2);
        }
    }
    Level { size: Size3::from_array(size), scale }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sizes(size: [u32; 3], spacing: [f64; 3]) -> Vec<[u32; 3]> {
        let levels = Levels::of(Size3::from_array(size), spacing, Size3::cube(32));
        levels.iter().map(|level| level.size.to_array()).collect()
    }

    #[test]
    fn isotropic_volumes_halve_every_axis_until_one_brick() {
        assert_eq!(sizes([256; 3], [1.0; 3]), [[256; 3], [128; 3], [64; 3], [32; 3]]);
        assert_eq!(sizes([33, 1, 1], [1.0; 3]), [[33, 1, 1], [17, 1, 1]]);
        assert_eq!(sizes([1, 1, 1], [1.0; 3]), [[1, 1, 1]]);
    }

    #[test]
    fn fine_axes_are_reduced_first() {
        let got = sizes([256, 256, 55], [0.9375, 0.9375, 3.0]);
        assert_eq!(got, [[256, 256, 55], [128, 128, 55], [64, 64, 55], [32, 32, 28]]);
    }

    #[test]
    fn an_axis_of_one_voxel_does_not_stop_the_rest() {
        assert_eq!(sizes([1, 1, 64], [0.001, 0.001, 5.0]), [[1, 1, 64], [1, 1, 32]]);
    }
}
