//! An optimization tool's process: the machine of the pool and what its shell does with it, in virtual time. What comes
//! out is compared with an undisturbed evaluation at once.

mod results;

use std::collections::VecDeque;
use std::rc::Rc;
use std::str::FromStr;
use std::time::{Duration, Instant};

use swarmwright_pool::{
    Action, Attempt, Config, Demand, Faults, Mode, Scheduler, Timeouts, WorkError,
};
use swarmwright_protocol::{Requirements, Topic, Topics};

use crate::network::Filter;
use crate::random::mix;
use crate::schedule::{self, Schedule};
use crate::server::Outgoing;
use crate::trail;

/// How long a server that is new waits for its first work, as in the pool's shell.
const PROBATION: Duration = Duration::from_millis(30);

/// How long servers may fail all before the work ends, as by default.
const PATIENCE: Duration = Duration::from_secs(10);

/// How far a tool is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// It waits for results.
    Working,
    /// It has those of one work and is to be given the next.
    Thinking,
    /// It has all results.
    Finished,
}

/// A tool: what survives its process, and the process.
pub struct Tool {
    plan: schedule::Tool,
    number: u64,
    /// The process, once it has begun.
    pub machine: Option<Scheduler>,
    /// Its name.
    pub name: String,
    /// How far it is.
    pub stage: Stage,
    /// Which work is under way.
    work: usize,
    /// The candidates that the machine knows, by its numbers.
    sent: Vec<usize>,
    /// Those that are still to be handed over.
    open: VecDeque<usize>,
    /// By candidate, once it has them.
    results: Vec<Option<Vec<f64>>>,
    expected: Vec<Option<f64>>,
    journal: Vec<Attempt>,
    /// Whether sound candidates may be reported failed.
    may_fail: bool,
    /// Whether servers may fail with any work.
    may_break: bool,
    /// Whether work may end without results, to be resumed.
    may_end: bool,
    /// Sound candidates that were reported failed since the process was given the work, and whether any evaluation has
    /// succeeded since.
    wronged: Vec<String>,
    succeeded: bool,
    /// Works that ended so.
    pub ended: usize,
    /// Evaluations that were reported failed although they could have been computed.
    pub failed: usize,
    /// Candidates whose results came.
    pub scored: usize,
    /// The last message to the user.
    pub warnings: VecDeque<String>,
}

impl Tool {
    /// A tool that has not begun.
    #[must_use]
    pub fn new(schedule: &Schedule, number: usize) -> Self {
        let plan = &schedule.tools[number];
        Self {
            plan: plan.clone(),
            number: number as u64,
            machine: None,
            name: String::new(),
            stage: Stage::Thinking,
            work: 0,
            sent: Vec::new(),
            open: VecDeque::new(),
            results: Vec::new(),
            expected: Vec::new(),
            journal: Vec::new(),
            may_fail: schedule.may_fail(plan),
            may_break: schedule.may_break(),
            may_end: schedule.may_end(),
            wronged: Vec::new(),
            succeeded: false,
            ended: 0,
            failed: 0,
            scored: 0,
            warnings: VecDeque::new(),
        }
    }

    /// The process starts.
    pub fn start(&mut self, incarnation: u64, now: Instant) {
        let name = format!("tool-{}-{incarnation}", self.number);
        let config = Config {
            demand: Demand {
                simulation: trail::TITLE.to_owned(),
                requirements: Requirements {
                    dimensions: 2.0,
                    max_agents: None,
                },
                sensors: Some(2),
                actuators: Some(1),
                mode: Mode::from_str(&self.plan.mode).unwrap_or_default(),
                kind: None,
                modules: Vec::new(),
                metrics: Vec::new(),
            },
            parameters: trail::parameters(),
            token: name.clone(),
            tool: name,
            topics: Topics::default(),
            visual: false,
            timeouts: Timeouts {
                step: Duration::from_micros(self.plan.step_timeout),
                ..Timeouts::default()
            },
            faults: Faults {
                attempts: self.plan.attempts,
                quarantine: self.plan.attempts,
                ..Faults::default()
            },
            largest: usize::MAX,
            probation: PROBATION,
            first_instance: mix(&[self.number, incarnation]) >> 12,
        };
        self.name.clone_from(&config.tool);
        self.machine = Some(Scheduler::new(config, now));
        self.stage = Stage::Thinking;
    }

    /// What it subscribes to, once it has begun.
    #[must_use]
    pub fn filters(&self, incarnation: u64) -> Vec<Filter> {
        let topics = Topics::default();
        let seed = [Topic::Server, Topic::Sensor, Topic::Fitness]
            .map(|topic| Filter::Exactly(topics.name(topic)));
        let reply = topics.to_tool(&format!("tool-{}-{incarnation}", self.number));
        let presence = topics.presence_filter().trim_end_matches('+').to_owned();
        seed.into_iter()
            .chain([Filter::Exactly(reply), Filter::Below(presence)])
            .collect()
    }

    fn salt(&self) -> u64 {
        mix(&[self.number, self.work as u64])
    }

    /// Hands over the next work, or the rest of the work in progress.
    ///
    /// # Errors
    /// None for works as they are drawn.
    pub fn submit(&mut self, now: Instant) -> Result<(), WorkError> {
        let (salt, plan) = (self.salt(), &self.plan.works[self.work]);
        self.expected = trail::expected(plan, salt)?;
        if plan.window.is_none() || self.results.len() != plan.candidates {
            self.results = vec![None; plan.candidates];
        }
        let results = self.results.iter().enumerate();
        let mut left: Vec<usize> = results
            .filter(|(_, result)| result.is_none())
            .map(|(index, _)| index)
            .collect();
        self.open = left
            .split_off(plan.window.unwrap_or(usize::MAX).min(left.len()))
            .into();
        self.sent = left;
        self.journal.clear();
        self.wronged.clear();
        self.succeeded = false;
        let work = trail::work(plan, salt, &self.sent)?;
        if let Some(machine) = &mut self.machine {
            machine.submit(work, now);
        }
        self.stage = Stage::Working;
        Ok(())
    }

    /// Takes what has come out.
    ///
    /// # Errors
    /// A result that is wrong, came twice, or failed without a cause.
    pub fn proceed(&mut self, now: Instant) -> Result<(), String> {
        let Some(machine) = self
            .machine
            .as_mut()
            .filter(|_| self.stage == Stage::Working)
        else {
            return Ok(());
        };
        if let Some(reason) = machine.undecided(PATIENCE, now) {
            return self.end(&reason);
        }
        self.journal.extend(
            machine
                .take_journal()
                .into_iter()
                .map(|(attempt, _)| attempt),
        );
        let plan = &self.plan.works[self.work];
        let mut rows = Vec::new();
        // What ends while others are handed over comes the next time.
        let all = machine.finished();
        if plan.window.is_some() {
            let settled = machine.take_settled();
            let fitness = settled.fitness.chunks(plan.episodes);
            rows.extend(
                settled
                    .candidates
                    .into_iter()
                    .zip(fitness.map(<[f64]>::to_vec)),
            );
            let more: Vec<usize> = (0..rows.len())
                .map_while(|_| self.open.pop_front())
                .collect();
            let salt = mix(&[self.number, self.work as u64]);
            let genomes: Vec<f32> = more
                .iter()
                .flat_map(|&index| trail::genome(plan, salt, index))
                .collect();
            machine
                .extend(&genomes, now)
                .map_err(|error| error.to_string())?;
            self.sent.extend(more);
        }
        let finished = all && machine.finished();
        if finished && plan.window.is_none() {
            let results = machine.take_results();
            let fitness = results.fitness.chunks(plan.episodes).map(<[f64]>::to_vec);
            rows.extend(fitness.enumerate());
            if rows.len() != self.sent.len() {
                return Err(format!(
                    "{} candidates have results, expected {}",
                    rows.len(),
                    self.sent.len()
                ));
            }
        }
        for (row, fitness) in rows {
            self.score(row, fitness)?;
        }
        if finished && !self.wronged.is_empty() && !self.succeeded {
            let wronged = self.wronged.join("; ");
            return self.end(&format!("every candidate failed: {wronged}"));
        }
        if (finished || self.succeeded)
            && let Some(wronged) = self.wronged.first()
        {
            return Err(wronged.clone());
        }
        if finished {
            self.conclude()?;
        }
        Ok(())
    }

    /// How long it thinks before the next work.
    #[must_use]
    pub fn pause(&self) -> u64 {
        self.plan.works.get(self.work).map_or(0, |work| work.pause)
    }

    /// What is to be sent.
    pub fn act(&mut self) -> Vec<Outgoing> {
        let topics = Topics::default();
        let Some(machine) = &mut self.machine else {
            return Vec::new();
        };
        let mut messages = Vec::new();
        for action in machine.actions() {
            let (topic, payload) = match action {
                Action::Publish(topic, payload) => (topics.name(topic), payload),
                Action::Control { server, payload }
                | Action::Request {
                    server, payload, ..
                } => (topics.to_server(server), payload),
                Action::Warn(text) | Action::Unaudited(text) | Action::Failed { text, .. } => {
                    if self.warnings.len() >= 50 {
                        self.warnings.pop_front();
                    }
                    self.warnings.push_back(text);
                    continue;
                }
                // No server of a schedule is a tool's own, and its broker collects nothing.
                Action::Overdue(_) | Action::AskBroker => continue,
            };
            messages.push(Outgoing {
                topic: topic.into(),
                payload: Rc::from(payload),
                retain: false,
                after: 0,
            });
        }
        messages
    }

    /// What is wrong with what the machine remembers, if anything.
    ///
    /// # Errors
    /// More than there can be.
    pub fn check_memory(&self, servers: usize) -> Result<(), String> {
        let Some(machine) = &self.machine else {
            return Ok(());
        };
        let held = machine.holdings();
        let ended = self.stage != Stage::Working;
        let most = |noun: &str, count: usize, limit: usize| {
            if count > limit {
                Err(format!(
                    "the tool holds {count} {noun}, at most {limit} make sense"
                ))
            } else {
                Ok(())
            }
        };
        let active = if ended { 0 } else { servers };
        most("servers", held.servers, servers)?;
        most("episodes", held.episodes, active)?;
        most("requests", held.requests, 2 * active)?;
        most("rounds", held.rounds, 16)?;
        most("complaints", held.warned_once, 1000)?;
        most(
            "evaluations that wait",
            held.queued,
            // Copies of slow work wait, too.
            if ended { 0 } else { 2 * self.expected.len() },
        )
    }
}
