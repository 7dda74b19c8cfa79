//! One ray through all volumes, from cut to cut.

use glam::DVec3;

use crate::reference::cell::{self, Grid};
use crate::reference::classify::Classifier;
use crate::reference::cubic::Cubic;
use crate::reference::quadrature::{Progress, Term};
use crate::volume::Voxels;

/// A channel ready to be sampled.
pub struct Channel<'a> {
    /// As stored.
    pub voxels: &'a Voxels,
    /// From stored values to colour and extinction.
    pub classifier: Classifier,
}

/// A volume ready to be walked.
pub struct Volume<'a> {
    /// Where its voxels are.
    pub grid: Grid,
    /// In the scene's order.
    pub channels: Vec<Channel<'a>>,
}

/// What all rays of a pixel have in common.
pub struct Ray<'a> {
    /// All that may be in the way.
    pub volumes: &'a [Volume<'a>],
    /// World length of the direction, whose multiples are the ray parameter.
    pub length_world: f64,
    /// The brightest of the background and 1.
    pub background_max: f64,
    /// Greatest absolute error of the pixel.
    pub tolerance: f64,
}

/// Memory that one thread's rays share, so that none is allocated per ray.
#[derive(Default)]
pub struct Scratch {
    walks: Vec<Walk>,
    shown: Vec<Shown>,
    cuts: Vec<f64>,
    terms: Vec<Term>,
}

/// A channel that shows something in the current stretch.
struct Shown {
    volume: usize,
    channel: usize,
    /// Windowed value over the stretch.
    unit: Cubic,
    rgb: Option<[Cubic; 3]>,
}

impl Ray<'_> {
    /// Premultiplied colour and optical depth along the ray whose origin and direction in the
    /// voxels of each volume are given, from parameter 0 on.
    pub fn integrate(
        &self,
        in_voxels: impl Iterator<Item = (DVec3, DVec3)>,
        scratch: &mut Scratch,
    ) -> ([f64; 3], f64) {
        scratch.walks.resize_with(self.volumes.len(), Walk::default);
        for ((walk, volume), (origin, direction)) in
            scratch.walks.iter_mut().zip(self.volumes).zip(in_voxels)
        {
            walk.begin(&volume.grid, origin, direction);
        }
        let channels = || self.volumes.iter().flat_map(|volume| &volume.channels);
        let color_max = channels().map(|c| c.classifier.color_max()).fold(0.0, f64::max);
        let mut progress = Progress::new(self.tolerance, color_max, self.background_max);
        let mut at = scratch.walks.iter().map(|walk| walk.enter).fold(f64::INFINITY, f64::min);
        loop {
            let cuts = scratch.walks.iter().filter_map(|walk| walk.next_cut(at));
            let to = cuts.fold(f64::INFINITY, f64::min);
            if to == f64::INFINITY {
                break;
            }
            if to > at {
                self.stretch(at, to, scratch, &mut progress);
                at = to;
            }
            for (walk, volume) in scratch.walks.iter_mut().zip(self.volumes) {
                walk.pass_planes(&volume.grid, at);
            }
        }
        (progress.color(), progress.depth())
    }

    /// Adds the stretch between two neighbouring cuts of the volumes' grids.
    fn stretch(&self, at: f64, to: f64, scratch: &mut Scratch, progress: &mut Progress) {
        let Scratch { walks, shown, cuts, terms } = scratch;
        shown.clear();
        cuts.clear();
        for (index, (walk, volume)) in walks.iter_mut().zip(self.volumes).enumerate() {
            if !walk.covers(at) || !walk.load(volume) {
                continue;
            }
            let (from, until) = (walk.fraction(at), walk.fraction(to));
            for (channel, corners) in walk.channels.iter().enumerate().filter(|(_, c)| c.shows) {
                let unit = cell::along(&corners.units, from, until);
                let rgb = corners.rgb.map(|rgb| rgb.map(|c| cell::along(&c, from, until)));
                if corners.crosses {
                    unit.crossings(volume.channels[channel].classifier.cuts(), cuts);
                }
                shown.push(Shown { volume: index, channel, unit, rgb });
            }
        }
        if shown.is_empty() {
            return;
        }
        cuts.push(1.0);
        cuts.sort_unstable_by(f64::total_cmp);
        let mut start = 0.0;
        for &end in cuts.iter() {
            if end <= start {
                continue;
            }
            terms.clear();
            terms.extend(shown.iter().filter_map(|shown| {
                let channel = &self.volumes[shown.volume].channels[shown.channel];
                shown.term(&channel.classifier, start, end)
            }));
            if !terms.is_empty() {
                progress.add(terms, self.length_world * (to - at) * (end - start));
                if progress.is_opaque_behind(progress.depth()) {
                    walks.iter_mut().for_each(|walk| walk.exit = f64::NEG_INFINITY);
                    return;
                }
            }
            start = end;
        }
    }
}

impl Shown {
    /// The polynomials between two neighbouring crossings, if anything shows there.
    fn term(&self, classifier: &Classifier, start: f64, end: f64) -> Option<Term> {
        let width = end - start;
        let piece = classifier.piece(self.unit.at(start + 0.5 * width));
        if piece.is_clear() {
            return None;
        }
        let is_linear = piece.start.is_finite() && piece.end.is_finite();
        let unit = if is_linear {
            let mut unit = self.unit.restricted(start, width);
            let at_ends = [unit.0[0], unit.at(1.0)];
            // Rounding may put the ends beside the piece, and a steep piece would make much of it.
            let [first, last] = at_ends.map(|end| end.clamp(piece.start, piece.end));
            let largest = self.unit.0.iter().fold(0.0, |most: f64, c| most.max(c.abs()));
            if largest * 1e-15 > 1e-6 * (piece.end - piece.start) {
                // Corner values so far outside the window that f64 cannot hold the differences
                // within it: the crossing is all but instantaneous, and straight.
                unit = Cubic([first - piece.anchor, last - first, 0.0, 0.0]);
            } else {
                let moved = [first - at_ends[0], last - at_ends[1]];
                unit.0[0] += moved[0] - piece.anchor;
                unit.0[1] += moved[1] - moved[0];
            }
            unit
        } else {
            Cubic([0.0; 4])
        };
        let mut extinction = Cubic(unit.0.map(|c| piece.extinction_slope * c));
        extinction.0[0] += piece.extinction;
        Some(Term {
            unit,
            extinction,
            color: piece.color,
            color_slope: piece.color_slope,
            rgb: self.rgb.map(|rgb| rgb.map(|c| c.restricted(start, width))),
        })
    }
}

/// The way of a ray through the cells of one volume.
#[derive(Default)]
struct Walk {
    origin: DVec3,
    direction: DVec3,
    /// Ray parameters of the box of voxel boxes; empty when they are not in order.
    enter: f64,
    exit: f64,
    /// The cell between voxel centres `cell` and `cell + 1`.
    cell: [i32; 3],
    /// Ray parameter of the next plane of voxel centres along each axis.
    planes: [f64; 3],
    is_loaded: bool,
    any_shows: bool,
    channels: Vec<Corners>,
}

/// One channel's values at the corners of the current cell.
#[derive(Clone, Copy, Default)]
struct Corners {
    shows: bool,
    /// Whether the transfer function has a cut between them.
    crosses: bool,
    units: [f64; 8],
    rgb: Option<[[f64; 8]; 3]>,
}

impl Walk {
    fn begin(&mut self, grid: &Grid, origin: DVec3, direction: DVec3) {
        (self.origin, self.direction) = (origin, direction);
        (self.enter, self.exit) = (0.0, f64::INFINITY);
        for axis in 0..3 {
            let (o, d, edge) = (origin[axis], direction[axis], grid.extent[axis]);
            if d == 0.0 {
                if !(0.0..edge).contains(&o) {
                    self.exit = f64::NEG_INFINITY;
                }
            } else {
                let (a, b) = ((0.0 - o) / d, (edge - o) / d);
                self.enter = self.enter.max(a.min(b));
                self.exit = self.exit.min(a.max(b));
            }
        }
        if self.exit <= self.enter {
            (self.enter, self.exit) = (f64::INFINITY, f64::NEG_INFINITY);
            return;
        }
        let start = origin + direction * self.enter;
        for axis in 0..3 {
            let cell = (start[axis] - 0.5).floor() as i32;
            self.cell[axis] = cell.clamp(-1, grid.size[axis] - 1);
            self.planes[axis] = self.plane(grid, axis);
        }
        self.is_loaded = false;
    }

    /// Where the current cell ends along an axis, computed from the cell so that nothing adds up.
    #[inline]
    fn plane(&self, grid: &Grid, axis: usize) -> f64 {
        let (cell, d) = (self.cell[axis], self.direction[axis]);
        let is_last = if d > 0.0 { cell >= grid.size[axis] - 1 } else { cell < 0 };
        if d == 0.0 || is_last {
            return f64::INFINITY;
        }
        let plane = f64::from(cell) + if d > 0.0 { 1.5 } else { 0.5 };
        (plane - self.origin[axis]) / d
    }

    /// The next ray parameter, not before `at`, at which something changes here.
    #[inline]
    fn next_cut(&self, at: f64) -> Option<f64> {
        if at >= self.exit {
            None
        } else if at < self.enter {
            Some(self.enter)
        } else {
            let [x, y, z] = self.planes;
            Some(x.min(y).min(z).min(self.exit))
        }
    }

    #[inline]
    fn covers(&self, at: f64) -> bool {
        at >= self.enter && at < self.exit
    }

    #[inline]
    fn pass_planes(&mut self, grid: &Grid, at: f64) {
        for axis in 0..3 {
            if self.planes[axis] <= at {
                self.cell[axis] += if self.direction[axis] > 0.0 { 1 } else { -1 };
                self.planes[axis] = self.plane(grid, axis);
                self.is_loaded = false;
            }
        }
    }

    /// Position within the cell, 0 to 1 along each axis.
    #[inline]
    fn fraction(&self, at: f64) -> DVec3 {
        let cell = DVec3::from_array(self.cell.map(f64::from)) + 0.5;
        (self.origin + self.direction * at - cell).clamp(DVec3::ZERO, DVec3::ONE)
    }

    /// Reads the corners of a new cell; whether any channel shows something in it. A channel with a
    /// NaN corner does not, nor does one whose corner values enclose nothing visible, since the
    /// trilinear value stays between them.
    #[inline]
    fn load(&mut self, volume: &Volume) -> bool {
        if !self.is_loaded {
            self.is_loaded = true;
            self.any_shows = false;
            self.channels.resize(volume.channels.len(), Corners::default());
            let corners = volume.grid.corners(self.cell);
            for (cell, channel) in self.channels.iter_mut().zip(&volume.channels) {
                let stored = cell::stored(channel.voxels, &corners);
                let (mut least, mut greatest, mut any_nan) = (stored[0], stored[0], false);
                for value in stored {
                    least = least.min(value);
                    greatest = greatest.max(value);
                    any_nan |= value.is_nan();
                }
                let classifier = &channel.classifier;
                let between = [classifier.unit(least), classifier.unit(greatest)];
                cell.shows = !any_nan && classifier.shows(between);
                if cell.shows {
                    cell.crosses = classifier.crosses(between);
                    for (unit, value) in cell.units.iter_mut().zip(stored) {
                        *unit = classifier.unit(value);
                    }
                    cell.rgb = cell::stored_rgb(channel.voxels, &corners);
                    self.any_shows = true;
                }
            }
        }
        self.any_shows
    }
}
