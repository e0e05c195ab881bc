//! Evaluation of work until it has ended or cannot continue.

use std::time::{Duration, Instant, SystemTime};

use super::{PROGRESS_INTERVAL, Pool};
use crate::journal::{Attempt, Warning};
use crate::scheduler::queue::results::{Results, Settled};
use crate::shell::error::PoolError;
use crate::shell::report::Report;
use crate::work::Work;

impl Pool {
    /// Returns whether to give up, as there has been no server since `since`. Outages do not count, unless one outage
    /// alone lasts for `patience`.
    pub(super) fn is_hopeless(&self, since: Instant, patience: Duration, now: Instant) -> bool {
        self.outages.reachable(since, now) >= patience || self.outages.down_for(now) >= patience
    }

    /// Returns the error for the lack of a server since `since`.
    pub(super) fn no_server(&self, since: Instant, now: Instant) -> PoolError {
        let url = self.connection.url();
        let outages = self.outages.describe(since, now, SystemTime::now());
        if let Some(outages) = outages.as_ref().filter(|_| self.outages.is_down()) {
            let outages = outages.clone();
            return PoolError::BrokerLost { url, outages };
        }
        let outages =
            outages.map(|periods| format!(", while the broker was not reachable {periods}"));
        PoolError::NoServer {
            url,
            seconds: now.saturating_duration_since(since).as_secs_f64(),
            outages: outages.unwrap_or_default(),
            description: self.scheduler.describe(),
            nothing: self.scheduler.found_nothing(),
            titles: self.scheduler.titles(),
        }
    }

    /// Describes the wait for the broker while it is unreachable.
    pub(super) fn waiting_for_broker(&self, now: Instant) -> Option<String> {
        self.outages.is_down().then(|| {
            let seconds = self.outages.down_for(now).as_secs_f64();
            let url = self.connection.url();
            format!("the broker on {url} has not been reachable for {seconds:.1} s")
        })
    }

    /// Evaluates all candidates in all episodes. `meanwhile` is called once, after servers have got their first work,
    /// and `on_progress(done, waiting_for)` ten times a second and at the end; both return false to stop the work.
    ///
    /// # Errors
    /// Fails if no server is found within the time-outs, if all servers refuse the work, or if a callback stops it. The
    /// work in flight is then ended.
    pub fn evaluate(
        &mut self,
        work: Work,
        meanwhile: impl FnOnce() -> bool,
        mut on_progress: impl FnMut(usize, &str) -> bool,
    ) -> Result<Results, PoolError> {
        self.drive(
            work,
            meanwhile,
            |_| Ok(true),
            |_, done, waiting_for| on_progress(done, waiting_for),
        )?;
        Ok(self.scheduler.take_results())
    }

    /// Like [`evaluate`](Self::evaluate), for use in a separate thread: `go_on` is asked whenever a message may have
    /// arrived, which a [`waker`](Self::waker) can trigger. Also returns the genomes.
    ///
    /// # Errors
    /// See [`evaluate`](Self::evaluate).
    pub fn evaluate_while(
        &mut self,
        work: Work,
        go_on: impl Fn() -> bool,
        mut on_progress: impl FnMut(usize, &str),
    ) -> Result<(Results, Vec<f32>), PoolError> {
        self.drive(
            work,
            || true,
            |_| go_on().then_some(true).ok_or(PoolError::Interrupted),
            |_, done, waiting_for| {
                on_progress(done, waiting_for);
                true
            },
        )?;
        let (results, work) = self.scheduler.take_all();
        Ok((results, work.map(Work::into_genomes).unwrap_or_default()))
    }

    /// Evaluates candidates as they arrive. `feed` receives the candidates whose episodes have all ended (none if there
    /// are only warnings), their attempts and the warnings. It returns the genomes of further candidates, (candidates,
    /// weights) row-major, or `None` to stop. The call returns when all candidates have ended and `feed` returned no
    /// more. `on_progress(done, total, waiting_for)` is called as in [`evaluate`](Self::evaluate).
    ///
    /// # Errors
    /// Also fails if the genomes do not match; see [`evaluate`](Self::evaluate).
    pub fn stream(
        &mut self,
        work: Work,
        mut feed: impl FnMut(Settled, Vec<Attempt>, Vec<Warning>) -> Option<Vec<f32>>,
        mut on_progress: impl FnMut(usize, usize, &str) -> bool,
    ) -> Result<(), PoolError> {
        let take = |pool: &mut Self| {
            let settled = pool.scheduler.take_settled();
            if settled.candidates.is_empty() && pool.warnings.is_empty() {
                return Ok(true);
            }
            let Some(genomes) = feed(settled, pool.take_journal(), pool.take_warnings()) else {
                return Ok(false);
            };
            pool.scheduler.extend(&genomes, Instant::now())?;
            pool.act();
            Ok(true)
        };
        let at_once = || true;
        self.drive(work, at_once, take, |pool, done, waiting_for| {
            on_progress(done, pool.scheduler.total(), waiting_for)
        })
    }

    /// Runs until everything has ended or a callback returns false: `step` is called whenever a message may have
    /// arrived, `meanwhile` once after servers have got their first work.
    fn drive(
        &mut self,
        work: Work,
        meanwhile: impl FnOnce() -> bool,
        mut step: impl FnMut(&mut Self) -> Result<bool, PoolError>,
        mut on_progress: impl FnMut(&Self, usize, &str) -> bool,
    ) -> Result<(), PoolError> {
        self.scheduler.submit(work, Instant::now());
        self.poll(Instant::now());
        let proceed = meanwhile();
        let mut asked_at = Instant::now();
        let patience = self.timeouts.discovery.max(self.timeouts.step);
        let mut free_since = asked_at;
        let result = loop {
            if !proceed {
                break Err(PoolError::Interrupted);
            }
            self.poll(asked_at + PROGRESS_INTERVAL);
            // Candidates that end during this step are taken by the next one.
            let all = self.scheduler.finished();
            match step(self) {
                Ok(true) => {}
                Ok(false) => break Ok(()),
                Err(error) => break Err(error),
            }
            let now = Instant::now();
            if all && self.scheduler.finished() {
                on_progress(self, self.scheduler.done(), "");
                let status = self.current_status(now);
                self.reporter.tell(&Report::Status {
                    status: &status,
                    traffic: self.connection.traffic(),
                    counts: *self.scheduler.counts(),
                });
                return Ok(());
            }
            if now.duration_since(asked_at) >= PROGRESS_INTERVAL {
                asked_at = now;
                if let Some(reason) = self.scheduler.disagreement() {
                    break Err(PoolError::Disagreement(reason.to_owned()));
                }
                if let Some(reason) = self.scheduler.hopeless() {
                    break Err(PoolError::TooLarge(reason.to_owned()));
                }
                if let Some(reason) = self.scheduler.undecided(self.timeouts.discovery, now) {
                    break Err(PoolError::Hopeless(reason));
                }
                if let Some(reason) = self.scheduler.rejected(now) {
                    break Err(PoolError::Rejected(reason));
                }
                let unserved_since = now.checked_sub(self.scheduler.unserved(now)).unwrap_or(now);
                if self.scheduler.busy_elsewhere().is_some() || self.supervision.are_starting() {
                    free_since = now;
                } else if self.is_hopeless(unserved_since.max(free_since), patience, now) {
                    break Err(self.no_server(unserved_since, now));
                }
                let waiting = self.waiting_for_broker(now);
                let waiting = waiting.unwrap_or_else(|| self.scheduler.waiting_for(now));
                if !on_progress(self, self.scheduler.done(), &waiting) {
                    break Err(PoolError::Interrupted);
                }
            }
        };
        self.scheduler.cancel();
        self.poll(Instant::now());
        result
    }
}
