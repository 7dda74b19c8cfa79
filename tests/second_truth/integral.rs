//! The pixel's integral straight from its definition, built of other parts than the reference: all cuts
//! of a ray at once instead of a walk, inverses by Cramer's rule, crossings by subdivision of Bernstein
//! polynomials, optical depth by Gauss points and colour by Gauss-Kronrod, with every value classified
//! where it is needed and nowhere as a polynomial.

use ashfall::scene::{Projection, TransferFunction, View, Volume};
use ashfall::volume::{VolumeVoxels, Voxels};
use glam::DVec3;

/// Nodes of Kronrod's rule with 15 points that are not negative; every other one is Gauss's.
pub const NODES: [f64; 8] = [
    0.991_455_371_120_812_6,
    0.949_107_912_342_758_5,
    0.864_864_423_359_769_1,
    0.741_531_185_599_394_4,
    0.586_087_235_467_691_1,
    0.405_845_151_377_397_2,
    0.207_784_955_007_898_47,
    0.0,
];
pub const KRONROD: [f64; 8] = [
    0.022_935_322_010_529_224,
    0.063_092_092_629_978_55,
    0.104_790_010_322_250_18,
    0.140_653_259_715_525_92,
    0.169_004_726_639_267_9,
    0.190_350_578_064_785_4,
    0.204_432_940_075_298_9,
    0.209_482_141_084_727_83,
];
/// Of nodes 1, 3, 5 and 7.
pub const GAUSS: [f64; 4] = [
    0.129_484_966_168_869_7,
    0.279_705_391_489_276_67,
    0.381_830_050_505_118_9,
    0.417_959_183_673_469_4,
];

/// Difference of the two rules that is accepted; Kronrod's own error is far below it.
const RULES_CLOSE: f64 = 1e-13;
/// Optical depth of a part that is accepted, unless what is before it hides it.
const DEPTH_MAX: f64 = 4.0;
/// Parts of a stretch between two cuts: 2^-60 of it is nothing.
const HALVINGS_MAX: u32 = 60;
/// Parts of a ray: a test that fails is better than one that never ends.
const PARTS_MAX: usize = 1_000_000;

/// One ray through one volume, in its voxels.
struct Crossed<'a> {
    scene: &'a Volume,
    voxels: &'a VolumeVoxels,
    size: [f64; 3],
    origin: DVec3,
    direction: DVec3,
}

/// A channel in one cell: its eight scaled and windowed corners, and its colours if it has any.
struct Seen<'a> {
    crossed: &'a Crossed<'a>,
    cell: [f64; 3],
    corners: [f64; 8],
    rgb: Option<[[f64; 8]; 3]>,
    transfer: &'a TransferFunction,
}

/// Premultiplied rgb and alpha of pixel (column, row) of a picture of `size` pixels.
pub fn pixel(
    view: &View,
    size: [u32; 2],
    (column, row): (u32, u32),
    volumes: &[(&Volume, &VolumeVoxels)],
) -> [f64; 4] {
    let (origin_world, direction_world) = ray(view, size.map(f64::from), column, row);
    let crossed: Vec<Crossed> = volumes
        .iter()
        .map(|&(scene, voxels)| crossed(scene, voxels, origin_world, direction_world))
        .collect();
    let mut cuts = vec![0.0];
    for one in &crossed {
        for axis in 0..3 {
            let (o, d, edge) = (one.origin[axis], one.direction[axis], one.size[axis]);
            let centres = (0..edge as u32).map(|voxel| f64::from(voxel) + 0.5);
            cuts.extend([0.0, edge].into_iter().chain(centres).map(|plane| (plane - o) / d));
        }
    }
    cuts.retain(|cut| cut.is_finite() && *cut >= 0.0);
    cuts.sort_by(f64::total_cmp);
    let mut ray = Sum { length: direction_world.length(), depth: 0.0, color: [0.0; 3], parts: 0 };
    for ends in cuts.windows(2).filter(|ends| ends[1] > ends[0]) {
        ray.stretch(&crossed, ends[0], ends[1]);
    }
    let [r, g, b] = ray.color;
    [r, g, b, -(-ray.depth).exp_m1()]
}

/// Through the middle of the pixel, whatever the projection.
fn ray(view: &View, [width, height]: [f64; 2], column: u32, row: u32) -> (DVec3, DVec3) {
    let (x, y) = ((f64::from(column) + 0.5) / width, (f64::from(row) + 0.5) / height);
    let upright = |half: f64| ((2.0 * x - 1.0) * half * width / height, (1.0 - 2.0 * y) * half);
    let across = |(u, v): (f64, f64)| view.right * u + view.up * v;
    match view.projection {
        Projection::Orthographic { height } => {
            (view.eye + across(upright(0.5 * height)), view.forward)
        }
        Projection::Perspective { fov_degrees } => {
            let half = (0.5 * fov_degrees * std::f64::consts::PI / 180.0).tan();
            (view.eye, view.forward + across(upright(half)))
        }
        Projection::Frustum { bounds: [left, right, bottom, top] } => {
            let at = (left * (1.0 - x) + right * x, top * (1.0 - y) + bottom * y);
            (view.eye, view.forward + across(at))
        }
    }
}

fn crossed<'a>(
    scene: &'a Volume,
    voxels: &'a VolumeVoxels,
    origin_world: DVec3,
    direction_world: DVec3,
) -> Crossed<'a> {
    let [x, y, z] = voxels.world_from_voxel.rows();
    let [a, b, c, corner] = [0, 1, 2, 3].map(|column| DVec3::new(x[column], y[column], z[column]));
    let whole = a.dot(b.cross(c));
    let solved =
        |v: DVec3| DVec3::new(v.dot(b.cross(c)), v.dot(c.cross(a)), v.dot(a.cross(b))) / whole;
    Crossed {
        scene,
        voxels,
        size: voxels.size.to_array().map(f64::from),
        origin: solved(origin_world - corner),
        direction: solved(direction_world),
    }
}

impl Crossed<'_> {
    fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }

    /// The channels that have something in the cell around the ray's parameter `t`.
    fn seen(&self, t: f64) -> Vec<Seen<'_>> {
        let place = self.at(t);
        if (0..3).any(|axis| !(0.0..self.size[axis]).contains(&place[axis])) {
            return Vec::new();
        }
        let cell = [0, 1, 2].map(|axis| (place[axis] - 0.5).floor());
        let voxel = |corner: usize| {
            let [x, y, z] = [0, 1, 2].map(|axis| {
                let index = cell[axis] + f64::from((corner >> axis & 1) as u32);
                index.clamp(0.0, self.size[axis] - 1.0) as usize
            });
            let [width, height, _] = self.size.map(|edge| edge as usize);
            x + width * (y + height * z)
        };
        let places: [usize; 8] = std::array::from_fn(voxel);
        let channels = self.scene.channels.iter().zip(&self.voxels.channels);
        let seen = channels.filter_map(|(channel, values)| {
            let [low, high] = channel.window;
            let unit = |place: usize| {
                let most = f64::from(f32::MAX);
                let stored = match &values.voxels {
                    Voxels::U8(v) => f64::from(v[place]),
                    Voxels::U16(v) => f64::from(v[place]),
                    Voxels::I16(v) => f64::from(v[place]),
                    Voxels::F32(v) => f64::from(v[place]).clamp(-most, most),
                    Voxels::Rgba8(v) => f64::from(v[place][3]),
                };
                (values.slope * stored + values.intercept - low) / (high - low)
            };
            let corners = places.map(unit);
            let rgb = match &values.voxels {
                Voxels::Rgba8(v) => {
                    let part = |c: usize| places.map(|place| f64::from(v[place][c]) / 255.0);
                    Some([part(0), part(1), part(2)])
                }
                _ => None,
            };
            let transfer = &channel.transfer;
            let seen = Seen { crossed: self, cell, corners, rgb, transfer };
            (!corners.iter().any(|corner| corner.is_nan())).then_some(seen)
        });
        seen.collect()
    }
}

impl Seen<'_> {
    /// Trilinear, one axis after the other. As differences: where all corners are equal, so is the value,
    /// to the last bit, and lies on one side of a jump that stands at it.
    fn mixed(&self, corners: &[f64; 8], t: f64) -> f64 {
        let place = self.crossed.at(t);
        let mut values = *corners;
        for axis in [2, 1, 0] {
            let upper = place[axis] - 0.5 - self.cell[axis];
            for low in 0..1 << axis {
                values[low] += upper * (values[low + (1 << axis)] - values[low]);
            }
        }
        values[0]
    }

    /// Extinction and colour.
    fn medium(&self, t: f64) -> (f64, [f64; 3]) {
        let unit = self.mixed(&self.corners, t).clamp(0.0, 1.0);
        let points = self.transfer.points();
        let (mut color, extinction) = match points.iter().rposition(|point| point.at <= unit) {
            None => (points[0].color, points[0].extinction),
            Some(last) if last + 1 == points.len() => (points[last].color, points[last].extinction),
            Some(before) => {
                let (p, q) = (&points[before], &points[before + 1]);
                let [to_p, to_q] = [unit - p.at, q.at - unit];
                let mix = |a: f64, b: f64| (a * to_q + b * to_p) / (q.at - p.at);
                let color = [0, 1, 2].map(|c| mix(p.color[c], q.color[c]));
                (color, mix(p.extinction, q.extinction))
            }
        };
        if let Some(rgb) = &self.rgb {
            (0..3).for_each(|c| color[c] *= self.mixed(&rgb[c], t));
        }
        (extinction, color)
    }

    /// Adds every parameter between `start` and `end` at which a point of the transfer function is met.
    fn kinks(&self, start: f64, end: f64, found: &mut Vec<f64>) {
        let [f0, f1, f2, f3] = [0.0, 1.0, 2.0, 3.0]
            .map(|third| self.mixed(&self.corners, start + (end - start) * third / 3.0));
        let scale = f0.abs().max(f1.abs()).max(f2.abs()).max(f3.abs()).max(1.0);
        for point in self.transfer.points() {
            // Bernstein coefficients of the cubic through four values.
            let bernstein = [
                f0 - point.at,
                (-5.0 * f0 + 18.0 * f1 - 9.0 * f2 + 2.0 * f3) / 6.0 - point.at,
                (2.0 * f0 - 9.0 * f1 + 18.0 * f2 - 5.0 * f3) / 6.0 - point.at,
                f3 - point.at,
            ];
            subdivide(bernstein, start, end, 1e-14 * scale, found);
        }
    }
}

/// Halves until no coefficient has another sign than the others, or all are as good as zero: below what
/// rounding leaves of a cubic that is zero everywhere, which would be halved without end.
fn subdivide(b: [f64; 4], start: f64, end: f64, nothing: f64, found: &mut Vec<f64>) {
    if b.iter().all(|b| *b > nothing) || b.iter().all(|b| *b < -nothing) {
        return;
    }
    let middle = 0.5 * (start + end);
    if b.iter().all(|b| b.abs() <= nothing) || middle <= start || middle >= end {
        found.push(middle);
        return;
    }
    let half = |p: f64, q: f64| 0.5 * (p + q);
    let [p, q, r] = [half(b[0], b[1]), half(b[1], b[2]), half(b[2], b[3])];
    let [u, v] = [half(p, q), half(q, r)];
    let w = half(u, v);
    subdivide([b[0], p, u, w], start, middle, nothing, found);
    subdivide([w, v, r, b[3]], middle, end, nothing, found);
}

/// What a ray has gathered.
struct Sum {
    /// World, of the direction.
    length: f64,
    depth: f64,
    color: [f64; 3],
    parts: usize,
}

impl Sum {
    /// Between two neighbouring cuts of all grids.
    fn stretch(&mut self, crossed: &[Crossed], start: f64, end: f64) {
        let seen: Vec<Seen> =
            crossed.iter().flat_map(|one| one.seen(0.5 * (start + end))).collect();
        if seen.is_empty() {
            return;
        }
        let mut cuts = vec![start, end];
        seen.iter().for_each(|channel| channel.kinks(start, end, &mut cuts));
        cuts.sort_by(f64::total_cmp);
        for ends in cuts.windows(2).filter(|ends| ends[1] > ends[0]) {
            self.smooth(&seen, ends[0], ends[1], 0);
        }
    }

    /// Gauss's two points are exact for a cubic, and neither is an end, where a jump may be.
    fn depth_between(&self, seen: &[Seen], start: f64, end: f64) -> f64 {
        let (middle, half) = (0.5 * (start + end), 0.5 * (end - start));
        let away = half / 3.0_f64.sqrt();
        let extinction = |t: f64| seen.iter().map(|channel| channel.medium(t).0).sum::<f64>();
        half * self.length * (extinction(middle - away) + extinction(middle + away))
    }

    fn smooth(&mut self, seen: &[Seen], start: f64, end: f64, halvings: u32) {
        self.parts += 1;
        assert!(self.parts < PARTS_MAX, "the second integrator does not converge");
        let depth = self.depth_between(seen, start, end);
        if depth == 0.0 {
            return;
        }
        let (middle, half) = (0.5 * (start + end), 0.5 * (end - start));
        let (mut kronrod, mut gauss) = ([0.0; 3], [0.0; 3]);
        for (index, node) in NODES.iter().enumerate() {
            for t in [middle - half * node, middle + half * node].into_iter().take(8 - index) {
                let transmitted = (-self.depth - self.depth_between(seen, start, t)).exp();
                for (extinction, color) in seen.iter().map(|channel| channel.medium(t)) {
                    for c in 0..3 {
                        let emitted = transmitted * extinction * color[c] * half * self.length;
                        kronrod[c] += KRONROD[index] * emitted;
                        gauss[c] += if index % 2 == 1 { GAUSS[index / 2] * emitted } else { 0.0 };
                    }
                }
            }
        }
        let apart = (0..3).map(|c| (kronrod[c] - gauss[c]).abs()).fold(0.0, f64::max);
        // Both rules agree on nothing where all nodes lie behind what is seen.
        let hides = depth > DEPTH_MAX && self.depth < 40.0;
        if (apart > RULES_CLOSE || hides)
            && halvings < HALVINGS_MAX
            && middle > start
            && middle < end
        {
            self.smooth(seen, start, middle, halvings + 1);
            self.smooth(seen, middle, end, halvings + 1);
            return;
        }
        (0..3).for_each(|c| self.color[c] += kronrod[c]);
        self.depth += depth;
    }
}
