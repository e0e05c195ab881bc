//! Many schedules, and what to say of those that fail.

use std::fmt;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::schedule::Schedule;
use crate::{check, draw, shrink};

/// What came out of many schedules.
#[derive(Debug, Default)]
pub struct Survey {
    /// The first seed.
    pub first: u64,
    /// How many were run.
    pub schedules: u64,
    /// Events in them.
    pub events: u64,
    /// Candidates that were scored.
    pub scored: u64,
    /// Evaluations that were reported failed although they could have been computed.
    pub failed: u64,
    /// Runs that ended without results, to be resumed.
    pub ended: u64,
    /// What is to be said of those that break a property.
    pub failures: Vec<String>,
}

impl fmt::Display for Survey {
    fn fmt(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        write!(
            formatter,
            "{} schedules from seed {}, {} events, {} candidates scored, {} evaluations reported failed, {} runs ended for want of \
             sound servers, {} violations",
            self.schedules,
            self.first,
            self.events,
            self.scored,
            self.failed,
            self.ended,
            self.failures.len()
        )
    }
}

/// Runs the schedules of `count` seeds from `first` on, in `jobs` threads, until `most` of them have failed.
#[must_use]
pub fn survey(first: u64, count: u64, jobs: usize, most: usize) -> Survey {
    let next = AtomicU64::new(0);
    let survey = Mutex::new(Survey {
        first,
        ..Survey::default()
    });
    let update = |change: &dyn Fn(&mut Survey)| {
        let mut survey = survey
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        change(&mut survey);
        survey.failures.len() < most
    };
    let work = || {
        loop {
            let index = next.fetch_add(1, Ordering::Relaxed);
            if index >= count {
                return;
            }
            let schedule = draw(first.wrapping_add(index));
            let report = check(&schedule, false);
            let failure = report.violation.as_ref().map(|_| tell(&schedule));
            let goes_on = update(&|survey| {
                survey.schedules += 1;
                survey.events += report.events;
                survey.scored += report.scored as u64;
                survey.failed += report.failed as u64;
                survey.ended += report.ended as u64;
                survey.failures.extend(failure.clone());
            });
            if !goes_on {
                return next.store(count, Ordering::Relaxed);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(work);
        }
    });
    survey
        .into_inner()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// Describes a failing schedule: the smallest one that also fails, its problem, and how to reproduce it.
#[must_use]
pub fn tell(schedule: &Schedule) -> String {
    let (small, report) = shrink(schedule);
    let json = serde_json::to_string(&small).unwrap_or_default();
    format!(
        "seed {} fails: {}\nthe smallest schedule that does, too:\n{small}repeat it with\n  cargo run --release \
         --manifest-path engine/Cargo.toml -p swarmwright-schedules -- --schedule '{json}' --log",
        schedule.seed,
        report.violation.unwrap_or_default()
    )
}
