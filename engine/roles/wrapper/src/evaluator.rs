//! Evaluator of jobs: jobs of some microseconds run in the calling thread, longer ones in another thread, so that the
//! MQTT thread keeps answering.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::Duration;

use swarmwright_lanes::Level;
use swarmwright_mqtt::Waker;
use swarmwright_worlds::Means;

use crate::job::{Done, Job, Setup};
use crate::progress::Progress;

/// Longest expected duration of a job in the MQTT thread; handing a job over and back costs about 20 us.
pub(crate) const SHORT: Duration = Duration::from_millis(1);

/// Returns the number of groups of episodes that are computed one after another; each takes the time of one episode.
fn groups(episodes: usize) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "far fewer than 2^53")]
    {
        episodes.div_ceil(Level::best().width()) as f64
    }
}

/// Evaluator that computes one job at a time.
pub(crate) struct Evaluator {
    means: Means,
    progress: Option<Arc<Progress>>,
    waker: Waker,
    worker: Option<(Sender<Job>, Receiver<Done>)>,
    /// Setup of the last job, and the seconds per group of episodes.
    pace: Option<(Arc<Setup>, f64)>,
}

impl Evaluator {
    /// Creates an evaluator. `waker` ends the wait of the MQTT thread when a result is available.
    pub fn new(threads: usize, progress: Option<Arc<Progress>>, waker: Waker) -> Self {
        let means = Means {
            threads,
            ..Means::default()
        };
        Self {
            means,
            progress,
            waker,
            worker: None,
            pace: None,
        }
    }

    /// Starts a job. Returns the result if it was computed at once.
    pub fn run(&mut self, job: Job) -> Option<Done> {
        let short = self.pace.as_ref().is_some_and(|(setup, seconds)| {
            Arc::ptr_eq(setup, &job.request.setup)
                && groups(job.episodes()) * seconds < SHORT.as_secs_f64()
        });
        let job = if short || job.episodes() == 0 {
            job
        } else {
            self.hand_over(job)?
        };
        let done = job.run_watched(self.means, self.progress.as_deref());
        self.learn(&done);
        Some(done)
    }

    /// Returns a result of the other thread, if there is one.
    pub fn finished(&mut self) -> Option<Done> {
        let done = self.worker.as_ref()?.1.try_recv().ok()?;
        self.learn(&done);
        Some(done)
    }

    fn learn(&mut self, done: &Done) {
        let episodes = done.request.candidates() * done.request.seeds.len();
        if episodes > 0 {
            let pace = done.seconds / groups(episodes);
            self.pace = Some((Arc::clone(&done.request.setup), pace));
        }
    }

    /// Hands the job to the other thread; returns it if no thread could be started.
    fn hand_over(&mut self, job: Job) -> Option<Job> {
        if self.worker.is_none() {
            self.worker = start(self.means, self.progress.clone(), self.waker.clone());
        }
        match &self.worker {
            Some((jobs, _)) => jobs.send(job).err().map(|error| error.0),
            None => Some(job),
        }
    }
}

/// Starts the thread, which ends when the sender of jobs is dropped.
fn start(
    means: Means,
    progress: Option<Arc<Progress>>,
    waker: Waker,
) -> Option<(Sender<Job>, Receiver<Done>)> {
    let (jobs, inbox) = channel::<Job>();
    let (outbox, done) = channel();
    let work = move || {
        for job in inbox {
            if outbox
                .send(job.run_watched(means, progress.as_deref()))
                .is_err()
            {
                break;
            }
            waker.wake();
        }
    };
    match thread::Builder::new()
        .name("evaluation".to_owned())
        .spawn(work)
    {
        Ok(_) => Some((jobs, done)),
        Err(error) => {
            log::warn!(
                "could not start a thread for evaluations, so the server answers late: {error}"
            );
            None
        }
    }
}
