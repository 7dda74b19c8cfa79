//! The loader threads and the two channels between them and the owner.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender, bounded};

use crate::error::{Error, Result};
use crate::loading::job::{Arrival, Inspect, Job, Sources};
use crate::loading::{DoneJob, LoadingLimits, Moments};

/// Jobs under way per loader: one at work, one that waits for it, so that no loader waits for the
/// owner; more would be out of reach of a better rank that comes later.
pub const JOBS_PER_LOADER: usize = 2;

/// How long dropping waits for loaders. One that is stuck in its source for longer is left behind: it
/// ends when the source lets go of it.
pub const PATIENCE: Duration = Duration::from_secs(1);

/// Threads named "loader 0", "loader 1" and so on.
///
/// The owner hands over at most [`Loaders::jobs_max`] jobs before it takes arrivals; both channels
/// have that length, so loaders never block on a send either.
pub struct Loaders {
    /// Nothing once they are told to stop.
    jobs: Option<Sender<Job>>,
    arrivals: Receiver<(Arrival, Option<DoneJob>)>,
    stop: Arc<AtomicBool>,
    /// Somebody wants to know what is done when.
    watched: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
    jobs_max: usize,
}

impl Loaders {
    /// Starts as many as there may be; where there is an `inspect`, it sees every brick that is read.
    ///
    /// # Errors
    /// When the machine gives no thread.
    pub fn start(
        sources: Sources,
        inspect: Option<Inspect>,
        limits: &LoadingLimits,
    ) -> Result<Loaders> {
        let (count, yielding) = (limits.loaders, limits.yielding);
        let jobs_max = count * JOBS_PER_LOADER;
        let (jobs, wanted) = bounded(jobs_max);
        let (send, arrivals) = bounded(jobs_max);
        let [stop, watched] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
        let mut loaders =
            Loaders { jobs: Some(jobs), arrivals, stop, watched, threads: Vec::new(), jobs_max };
        let started = (0..count).try_for_each(|number| {
            let loader = Loader {
                number,
                sources: Arc::clone(&sources),
                inspect: inspect.clone(),
                jobs: wanted.clone(),
                arrivals: send.clone(),
                stop: Arc::clone(&loaders.stop),
                watched: Arc::clone(&loaders.watched),
            };
            let named = Builder::new().name(format!("loader {number}"));
            let run = move || {
                if yielding {
                    stand_back();
                }
                loader.run();
            };
            loaders.threads.push(named.spawn(run)?);
            io::Result::Ok(())
        });
        // Only loaders may hold a sender: dropping waits until there is none.
        drop(send);
        started.map_err(|why| {
            Error::machine(format!(
                "loading: no thread for loader {} of {count}: {why}; use fewer loaders",
                loaders.threads.len()
            ))
        })?;
        Ok(loaders)
    }

    /// Jobs that may be under way.
    pub fn jobs_max(&self) -> usize {
        self.jobs_max
    }

    /// From the next job on, arrivals come with when things were done.
    pub fn watch(&self) {
        self.watched.store(true, Ordering::Relaxed);
    }

    /// Gives a job away without waiting; false when there is no room for it.
    pub fn hand(&self, job: Job) -> bool {
        self.jobs.as_ref().is_some_and(|jobs| jobs.try_send(job).is_ok())
    }

    /// The next arrival, if one comes in time. One that is there comes even if the time has passed.
    pub fn next(&self, until: Option<Instant>) -> Option<(Arrival, Option<DoneJob>)> {
        match until {
            Some(until) => self.arrivals.recv_deadline(until).ok(),
            None => self.arrivals.recv().ok(),
        }
    }
}

impl Drop for Loaders {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.jobs = None;
        let until = Instant::now() + PATIENCE;
        // Each loader that ends drops its sender; after the last one the channel says so.
        let all_ended = loop {
            match self.arrivals.recv_deadline(until) {
                Ok(_) => {}
                Err(end) => break end.is_disconnected(),
            }
        };
        for thread in self.threads.drain(..) {
            if all_ended || thread.is_finished() {
                // Panics of what they call are caught, so there is nothing to hear here.
                let _ = thread.join();
            }
        }
    }
}

/// The nice value of loaders that stand back: a tenth of a core's time beside rays that want all of it.
#[cfg(target_os = "linux")]
const STAND_BACK: i32 = 10;

/// Lowers the priority of this thread, where the system has one for each.
fn stand_back() {
    #[cfg(target_os = "linux")]
    {
        // A system that does not let it costs time, not pictures.
        let _ = rustix::process::setpriority_process(Some(rustix::thread::gettid()), STAND_BACK);
    }
}

struct Loader {
    number: usize,
    sources: Sources,
    inspect: Option<Inspect>,
    jobs: Receiver<Job>,
    arrivals: Sender<(Arrival, Option<DoneJob>)>,
    stop: Arc<AtomicBool>,
    watched: Arc<AtomicBool>,
}

impl Loader {
    fn run(self) {
        #[cfg(feature = "tracy")]
        if let Some(client) = tracy_client::Client::running() {
            client.set_thread_name(&format!("loader {}", self.number));
        }
        let mut buffer = Vec::new();
        for job in &self.jobs {
            // Jobs that were handed over before the stop are not worth a read.
            if self.stop.load(Ordering::Relaxed) {
                return;
            }
            let mut moments = self.watched.load(Ordering::Relaxed).then(Moments::begin);
            let inspect = self.inspect.as_ref();
            let arrival = job.run(&self.sources, inspect, &mut buffer, moments.as_mut());
            let done = moments.map(|moments| DoneJob {
                loader: self.number,
                moments,
                end: Instant::now(),
                work: arrival.work(),
            });
            if self.arrivals.send((arrival, done)).is_err() {
                return;
            }
        }
    }
}
