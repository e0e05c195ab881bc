//! Threads that compute password hashes.

use super::queue::Key;
use super::users::Users;
use std::io;
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Largest number of threads; otherwise, half of the processors are used.
const MOST: usize = 4;

/// A password to check.
pub struct Job {
    pub users: Arc<Users>,
    pub generation: u64,
    pub pair: Key,
    pub user: String,
    pub password: Vec<u8>,
}

/// A checked password.
pub struct Done {
    pub generation: u64,
    pub pair: Key,
    pub user: String,
    pub is_right: bool,
    /// Processor time of the check.
    pub took: Duration,
}

type Wake = Arc<Mutex<Box<dyn Fn() + Send>>>;

/// The threads and their channels; dropping it ends the threads.
pub struct Workers {
    jobs: Option<Sender<Job>>,
    results: Receiver<Done>,
    wake: Wake,
    threads: Vec<JoinHandle<()>>,
}

impl Workers {
    pub fn start() -> io::Result<Self> {
        let (jobs, queue) = mpsc::channel();
        let (sender, results) = mpsc::channel();
        let queue = Arc::new(Mutex::new(queue));
        let wake: Wake = Arc::new(Mutex::new(Box::new(|| {})));
        let processors = thread::available_parallelism().map_or(1, usize::from);
        let threads = (0..(processors / 2).clamp(1, MOST))
            .map(|_| {
                let (queue, sender, wake) = (Arc::clone(&queue), sender.clone(), Arc::clone(&wake));
                thread::Builder::new()
                    .name("mqtt-passwords".into())
                    .spawn(move || work(&queue, &sender, &wake))
            })
            .collect::<io::Result<_>>()?;
        Ok(Self {
            jobs: Some(jobs),
            results,
            wake,
            threads,
        })
    }

    pub fn count(&self) -> usize {
        self.threads.len()
    }

    pub fn wake_with(&mut self, wake: Box<dyn Fn() + Send>) {
        *self.wake.lock().unwrap_or_else(PoisonError::into_inner) = wake;
    }

    pub fn look(&self, job: Job) {
        if let Some(jobs) = &self.jobs
            && jobs.send(job).is_err()
        {
            log::error!("the threads that check passwords have ended");
        }
    }

    pub fn done(&self) -> Vec<Done> {
        self.results.try_iter().collect()
    }
}

impl Drop for Workers {
    fn drop(&mut self) {
        self.jobs = None;
        for thread in self.threads.drain(..) {
            if thread.join().is_err() {
                log::error!("a thread that checks passwords had failed");
            }
        }
    }
}

fn work(queue: &Mutex<Receiver<Job>>, results: &Sender<Done>, wake: &Wake) {
    loop {
        let next = queue.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(job) = next else { return };
        let (began, cpu) = (Instant::now(), cpu_time());
        let is_right = job.users.admit(&job.user, &job.password);
        let took = match (cpu, cpu_time()) {
            (Some(before), Some(after)) => after.saturating_sub(before),
            _ => began.elapsed(),
        };
        let done = Done {
            generation: job.generation,
            is_right,
            pair: job.pair,
            user: job.user,
            took,
        };
        if results.send(done).is_err() {
            return;
        }
        wake.lock().unwrap_or_else(PoisonError::into_inner)();
    }
}

/// Returns the processor time of this thread, if the system reports it; on a busy machine, a check takes longer than
/// that.
fn cpu_time() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    text.split(' ')
        .next()?
        .parse()
        .ok()
        .map(Duration::from_nanos)
}
