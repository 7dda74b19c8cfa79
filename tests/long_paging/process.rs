//! What the system says of this process; 0 where it says nothing.

use std::path::PathBuf;
use std::time::Duration;

use malloc_info::info::{SystemType, TotalType};

/// Of a moment in which nothing but the device should be alive.
#[derive(Clone, Copy, Debug)]
pub struct Facts {
    pub resident_mb: f64,
    /// What the process's allocator has given out: to us, to the driver and to its layers. Unlike resident
    /// memory it counts no gaps between what was given back.
    pub in_use_mb: f64,
    pub files: usize,
    pub threads: usize,
}

impl Facts {
    pub fn now() -> Facts {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        let kib = line.and_then(|line| line.trim().trim_end_matches(" kB").parse::<f64>().ok());
        Facts {
            resident_mb: kib.unwrap_or(0.0) * 1024e-6,
            in_use_mb: in_use_bytes() as f64 * 1e-6,
            files: std::fs::read_dir("/proc/self/fd").map_or(0, Iterator::count),
            // The driver makes threads for its cache on disk when it sees fit, and keeps them.
            threads: threads(|name| !name.contains(":disk$")),
        }
    }
}

/// What this process's file descriptors lead to.
pub fn open_files() -> Vec<PathBuf> {
    let Ok(open) = std::fs::read_dir("/proc/self/fd") else { return Vec::new() };
    open.flatten().filter_map(|file| std::fs::read_link(file.path()).ok()).collect()
}

fn in_use_bytes() -> usize {
    let said = malloc_info::malloc_info().expect("the C library's allocator tells");
    let system: usize = said
        .system
        .iter()
        .filter(|one| one.r#type == SystemType::Current)
        .map(|one| one.size)
        .sum();
    let total = |kind| said.total.iter().filter(|one| one.r#type == kind).map(|one| one.size).sum();
    let [fast, rest, mapped]: [usize; 3] =
        [TotalType::Fast, TotalType::Rest, TotalType::Mmap].map(total);
    (system + mapped).saturating_sub(fast + rest)
}

/// Threads whose name begins so.
pub fn threads_named(begin: &str) -> usize {
    threads(|name| name.starts_with(begin))
}

fn threads(counts: impl Fn(&str) -> bool) -> usize {
    let Ok(tasks) = std::fs::read_dir("/proc/self/task") else { return 0 };
    let name = |task: std::fs::DirEntry| std::fs::read_to_string(task.path().join("comm"));
    tasks.flatten().filter_map(|task| name(task).ok()).filter(|name| counts(name)).count()
}

/// Waits for what should soon be so; false when it never was.
pub fn soon(mut so: impl FnMut() -> bool) -> bool {
    (0..1000).any(|_| {
        let now = so();
        if !now {
            std::thread::sleep(Duration::from_millis(10));
        }
        now
    })
}

/// Slope of the straight line nearest to points (x, y); 0 of fewer than two.
pub fn slope(points: &[(f64, f64)]) -> f64 {
    let count = points.len().max(1) as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| points.iter().map(of).sum::<f64>() / count;
    let (mean_x, mean_y) = (mean(|point| point.0), mean(|point| point.1));
    let both: f64 = points.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    let square: f64 = points.iter().map(|(x, _)| (x - mean_x).powi(2)).sum();
    if square > 0.0 { both / square } else { 0.0 }
}

#[test]
fn a_line_has_its_slope() {
    let line: Vec<_> = (0..9).map(|x| (f64::from(x), 3.0 - 0.5 * f64::from(x))).collect();
    assert!((slope(&line) + 0.5).abs() < 1e-12);
    assert_eq!((slope(&line[..1]), slope(&[])), (0.0, 0.0));
}
