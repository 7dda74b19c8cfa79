//! Which page is which slice, channel and time step: ImageJ's and OME's words for it.

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;

use crate::error::{Error, Result};
use crate::import::text::{number, shown};
use crate::import::xml::Tags;
use crate::import::{CHANNELS_MAX, EDGE_VOXELS_MAX};

/// Planes of one file: numbers of planes and sums of two of them stay far from overflow.
const PLANES_MAX: u64 = 1 << 48;

/// How pages make up volumes.
#[derive(Debug)]
pub struct Stack {
    pub format_name: &'static str,
    pub slices: u32,
    /// Channels by page; each may hold several samples.
    pub channels: u32,
    pub times: u32,
    /// Page of each plane there is: plane = (time * slices + slice) * channels + channel.
    pub pages: Pages,
    /// Of x, y and z, where known.
    pub spacing: [Option<f64>; 3],
    pub unit: Option<String>,
    pub notes: Vec<String>,
}

/// Which page each plane is. What a description promises costs no memory before it is checked.
#[derive(Debug)]
pub enum Pages {
    /// As many planes as pages, in the same order.
    InOrder(u64),
    /// By plane; no more of them than the file has pages.
    Placed(BTreeMap<u64, usize>),
}

impl Pages {
    /// Planes that have a page.
    pub fn count(&self) -> u64 {
        match self {
            Pages::InOrder(count) => *count,
            Pages::Placed(pages) => pages.len() as u64,
        }
    }

    /// Planes that have a page, of some planes.
    pub fn count_within(&self, planes: Range<u64>) -> u64 {
        match self {
            Pages::InOrder(count) => planes.end.min(*count).saturating_sub(planes.start),
            Pages::Placed(pages) => pages.range(planes).count() as u64,
        }
    }

    /// Plane and page of some planes.
    pub fn within(&self, planes: Range<u64>) -> Vec<(u64, usize)> {
        match self {
            Pages::InOrder(count) => (planes.start..planes.end.min(*count))
                .map(|plane| (plane, plane as usize))
                .collect(),
            Pages::Placed(pages) => {
                pages.range(planes).map(|(plane, page)| (*plane, *page)).collect()
            }
        }
    }
}

impl Stack {
    fn new(format_name: &'static str, counts: [u64; 3]) -> Result<Stack> {
        let [slices, channels, times] = counts;
        let max = [EDGE_VOXELS_MAX, CHANNELS_MAX, EDGE_VOXELS_MAX];
        let planes = counts.iter().map(|count| u128::from(*count)).product::<u128>();
        if counts.iter().zip(max).any(|(count, max)| *count == 0 || *count > max)
            || planes > u128::from(PLANES_MAX)
        {
            return Err(Error::input(format!(
                "its description promises {slices} slices, {channels} channels and {times} time steps"
            )));
        }
        Ok(Stack {
            format_name,
            slices: slices as u32,
            channels: channels as u32,
            times: times as u32,
            pages: Pages::InOrder(0),
            spacing: [None; 3],
            unit: None,
            notes: Vec::new(),
        })
    }

    /// Planes of all slices, channels and time steps.
    pub fn planes(&self) -> u64 {
        u64::from(self.slices) * u64::from(self.channels) * u64::from(self.times)
    }

    /// Every page is a slice.
    pub fn plain(pages: usize) -> Result<Stack> {
        let mut stack = Stack::new("TIFF", [pages as u64, 1, 1])?;
        stack.pages = Pages::InOrder(pages as u64);
        Ok(stack)
    }

    /// As an ImageJ description says. With one page, all images may lie one after another behind it.
    pub fn imagej(description: &str, pages: usize) -> Result<Stack> {
        let fields: HashMap<&str, &str> =
            description.lines().filter_map(|line| line.split_once('=')).collect();
        let count = |name| fields.get(name).map(|value| number::<u64>(name, value)).transpose();
        let (channels, frames) = (count("channels")?.unwrap_or(1), count("frames")?.unwrap_or(1));
        let images = count("images")?.unwrap_or(pages as u64);
        let slices = match count("slices")? {
            Some(slices) => slices,
            None => images / channels.saturating_mul(frames).max(1),
        };
        let mut stack = Stack::new("ImageJ TIFF", [slices, channels, frames])?;
        if stack.planes() != images || (pages as u64 != images && pages != 1) {
            return Err(Error::input(format!(
                "its description promises {slices} slices, {channels} channels and {frames} frames in \
                 {images} images, but there are {pages} pages"
            )));
        }
        // ImageJ's order is always channel, slice, frame.
        stack.pages = Pages::InOrder(images);
        stack.unit = fields.get("unit").map(|unit| unescaped(unit)).filter(|unit| unit != "pixel");
        let spacing = fields.get("spacing").and_then(|spacing| spacing.trim().parse::<f64>().ok());
        stack.spacing[2] = spacing.map(f64::abs).filter(|spacing| *spacing > 0.0);
        Ok(stack)
    }

    /// As an OME-XML description says; `samples` are those of one pixel of a page.
    pub fn ome(description: &str, pages: usize, samples: u64) -> Result<Stack> {
        let mut tags = Tags::new(description.as_bytes());
        let mut file_id = None;
        let mut pixels = None;
        let mut data = Vec::new();
        while let Some(tag) = tags.next()? {
            match tag.name.as_str() {
                "OME" => file_id = tag.get("UUID").map(str::to_owned),
                "Pixels" => pixels = Some(tag),
                "TiffData" => data.push(tag),
                "/UUID" if file_id.as_ref().is_some_and(|id| *id != tag.text) => {
                    return Err(Error::input(
                        "its planes are spread over several files, which is not supported: join them",
                    ));
                }
                "/Pixels" => break,
                _ => {}
            }
        }
        let pixels = pixels.ok_or_else(|| Error::input("its OME-XML has no Pixels"))?;
        let order = Order::of(pixels.get("DimensionOrder").unwrap_or("XYZCT"))?;
        let count = |name: &str| pixels.get(name).map_or(Ok(1), |value| number::<u64>(name, value));
        let channels = count("SizeC")?;
        if !channels.is_multiple_of(samples) {
            return Err(Error::input(format!(
                "its OME-XML promises {channels} channels in pages of {samples} each"
            )));
        }
        let mut stack =
            Stack::new("OME-TIFF", [count("SizeZ")?, channels / samples, count("SizeT")?])?;
        let mut placed = BTreeMap::new();
        let mut pages_used = 0;
        if data.is_empty() {
            stack.place(&mut placed, &order, [0; 3], 0, pages);
        }
        for tag in &data {
            let at = |name: &str| tag.get(name).map_or(Ok(0), |value| number::<u64>(name, value));
            // Pixels' channels count samples, planes do not.
            let first = [at("FirstZ")?, at("FirstC")? / samples, at("FirstT")?];
            let page = at("IFD")?.min(pages as u64) as usize;
            let count = match tag.get("PlaneCount") {
                Some(count) => number::<u64>("PlaneCount", count)?,
                None if tag.get("IFD").is_some() => 1,
                None => pages as u64,
            };
            let count = count.min((pages - page) as u64) as usize;
            pages_used += count;
            if pages_used > pages {
                return Err(Error::input("its OME-XML places a page more than once"));
            }
            stack.place(&mut placed, &order, first, page, count);
        }
        stack.pages = Pages::Placed(placed);
        let unit = |name| pixels.get(name).unwrap_or("\u{b5}m");
        for (axis, name) in
            ["PhysicalSizeX", "PhysicalSizeY", "PhysicalSizeZ"].into_iter().enumerate()
        {
            let size = pixels.get(name).and_then(|size| size.parse::<f64>().ok());
            stack.spacing[axis] = size.filter(|size| size.is_finite() && *size > 0.0);
        }
        if stack.spacing.iter().any(Option::is_some) {
            let x = unit("PhysicalSizeXUnit");
            if [unit("PhysicalSizeYUnit"), unit("PhysicalSizeZUnit")].iter().any(|unit| *unit != x)
            {
                stack
                    .notes
                    .push("units of x, y and z differ: sizes are kept as numbers".to_owned());
            }
            stack.unit = Some(x.to_owned());
        }
        Ok(stack)
    }

    /// Gives `count` pages from `page` on to the planes from (slice, channel, time) on.
    fn place(
        &self,
        placed: &mut BTreeMap<u64, usize>,
        order: &Order,
        first: [u64; 3],
        page: usize,
        count: usize,
    ) {
        let sizes = [self.slices, self.channels, self.times].map(u64::from);
        if first.iter().zip(sizes).any(|(first, size)| *first >= size) {
            return;
        }
        let strides = order.strides(sizes);
        let start: u64 = first.iter().zip(strides).map(|(first, stride)| first * stride).sum();
        for (page, place) in (page..page + count).zip(start..self.planes()) {
            let [slice, channel, time] =
                std::array::from_fn(|axis| place / strides[axis] % sizes[axis]);
            let plane = (time * sizes[0] + slice) * sizes[1] + channel;
            placed.insert(plane, page);
        }
    }
}

/// The order of slice, channel and time in a file: position of each, fastest first.
struct Order([usize; 3]);

impl Order {
    fn of(name: &str) -> Result<Order> {
        let rank = |letter| name.strip_prefix("XY").and_then(|rest| rest.find(letter));
        match (rank('Z'), rank('C'), rank('T')) {
            (Some(z), Some(c), Some(t)) if name.len() == 5 => Ok(Order([z, c, t])),
            _ => Err(Error::input(format!(
                "its dimension order \"{}\" is not one like XYZCT",
                shown(name)
            ))),
        }
    }

    fn strides(&self, sizes: [u64; 3]) -> [u64; 3] {
        self.0.map(|rank| {
            (0..3).filter(|axis| self.0[*axis] < rank).map(|axis| sizes[axis]).product::<u64>()
        })
    }
}

/// ImageJ writes a micro sign as an escape.
fn unescaped(unit: &str) -> String {
    unit.trim().replace("\\u00B5", "\u{b5}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ome_planes_follow_the_dimension_order() {
        let text = "<OME><Pixels DimensionOrder='XYCTZ' SizeC='2' SizeT='3' SizeZ='2'/></OME>";
        let stack = Stack::ome(text, 12, 1).unwrap();
        // Page 7 is channel 1, time 0, slice 1.
        assert!(stack.pages.within(3..4) == [(3, 7)]);
        let text = "<OME><Pixels DimensionOrder='XYZCT' SizeZ='4'><TiffData FirstZ='2' IFD='0'/></Pixels></OME>";
        let stack = Stack::ome(text, 1, 1).unwrap();
        assert_eq!(stack.pages.within(0..4), [(2, 0)]);
    }
}
