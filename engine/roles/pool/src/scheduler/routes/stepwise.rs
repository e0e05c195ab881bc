//! Stepwise episodes: each step is a message through the broker (docs/reference/protocol.md).

use std::time::{Duration, Instant};

use swarmwright_protocol::{
    DecodeError, Failed, Fitness, MOST_REASON, ParametersMessage, ReadingWriter, SensorReading,
    Topic, shortened,
};

use crate::journal::{Attempt, Outcome};
use crate::metrics::needed;
use crate::mode::Mode;
use crate::scheduler::job::Job;
use crate::scheduler::modes::episode::Episode;
use crate::scheduler::queue::blame::{Blame, Cause};
use crate::scheduler::queue::piece::Piece;
use crate::scheduler::queue::results::ServerResult;
use crate::scheduler::{Action, Scheduler};

/// Largest number of characters of a foreign title in messages.
const MOST_TITLE: usize = 200;
/// Number of times in a row that another tool may get a server first before the server itself is blamed.
const MOST_PREEMPTIONS: u32 = 5;

impl Scheduler {
    pub(crate) fn start_episode(&mut self, piece: Piece, server: u64, now: Instant) {
        let (candidates, episodes) = self.ledger.extent(&piece);
        let Some(work) = self.ledger.work() else {
            return;
        };
        let prototype = match work.controller(candidates.start) {
            Ok(prototype) => prototype,
            Err(_) => return self.give_up(&piece, true, now),
        };
        let (parameters, hash) = self
            .messages
            .episode(&self.config, &prototype, episodes.start);
        let message = ParametersMessage {
            server,
            simulation_hash: hash.clone(),
            parameters,
        };
        let payload = message.encode();
        if let Some(reason) =
            self.limits
                .too_large(&self.config.topics, Topic::Parameters, payload.len())
        {
            self.ledger.put_back(&piece);
            return self.not_for(server, &reason, now);
        }
        self.publish(Topic::Parameters, payload);
        self.control(server, hash.clone(), true);
        self.fleet.sent_to(server, 2);
        let writer = ReadingWriter::actuator(&self.config.demand.simulation, &hash);
        let round = self.discovery.round();
        let run = Episode::new(
            piece,
            server,
            prototype,
            self.messages.agents(),
            writer,
            round,
            now,
        );
        self.in_flight.begin_episode(hash.clone(), run);
        self.fleet.began(server, Job::Episode(hash));
    }

    pub(crate) fn sensor(&mut self, sensor: &SensorReading, now: Instant) {
        let title = sensor.simulation.as_deref();
        if self.is_of_another(Topic::Sensor, title, &sensor.simulation_hash) {
            return;
        }
        let Some(run) = self.in_flight.episode_mut(&sensor.simulation_hash) else {
            return self.end_late_run(&sensor.simulation_hash);
        };
        if let Some(round) = run.deserted_in(now) {
            let server = run.server;
            return self.found_two(server, round, now);
        }
        let since = now.saturating_duration_since(run.heard());
        run.sensors_came(self.discovery.round());
        match run.answer(sensor, now) {
            Ok(actuator) => {
                let (server, bytes) = (run.server, actuator.len());
                if let Some(reason) =
                    self.limits
                        .too_large(&self.config.topics, Topic::Actuator, bytes)
                {
                    self.end_run(server, &sensor.simulation_hash);
                    return self.not_for(server, &reason, now);
                }
                self.fleet.measured_step(server, since);
                self.fleet.heard(server, now);
                self.publish(Topic::Actuator, actuator);
                self.answered_after(server, since);
                self.fleet.sent_to(server, 1);
            }
            Err(reason) if !run.steers() => {
                let server = run.server;
                self.end_run(server, &sensor.simulation_hash);
                self.not_for(server, &reason, now);
            }
            Err(reason) => {
                let server = run.server;
                run.refuse(reason.clone(), now);
                self.outbox.warn_once(format!(
                    "refusing a sensor message of server {server}: {reason}"
                ));
            }
        }
    }

    /// Records an answer of a server in an episode after a wait of this length.
    fn answered_after(&mut self, server: u64, wait: Duration) {
        if self.fleet.answered_after(server, wait) {
            self.outbox.push(Action::AskBroker);
        }
    }

    /// Returns whether a message for an episode in flight names another simulation. Such a message comes from another
    /// server with the same id; messages of the right server still count.
    fn is_of_another(&mut self, topic: Topic, title: Option<&str>, hash: &str) -> bool {
        let expected = &self.config.demand.simulation;
        let Some(title) = title.filter(|title| title != expected) else {
            return false;
        };
        let Some(run) = self.in_flight.episode(hash) else {
            return false;
        };
        let (server, name) = (run.server, topic.name());
        let title = shortened(title.to_owned(), MOST_TITLE);
        let reason = format!("a {name} message is of simulation {title:?}, not {expected:?}");
        self.counts.foreign += 1;
        self.outbox.warn_counted(format!(
            "refusing messages under the id of server {server}: {reason}; check whether another server has this id"
        ));
        true
    }

    /// Ends an episode that is not in flight although its sensors arrived: its server began it late or a second time,
    /// and would wait in vain.
    fn end_late_run(&mut self, hash: &str) {
        if let Some((server, _)) = self.in_flight.ended(hash) {
            self.end_run(server, hash);
        }
    }

    /// Excludes a server that can never do the work; others may be able to.
    pub(crate) fn not_for(&mut self, server: u64, reason: &str, now: Instant) {
        self.outlook.refused(now);
        self.outbox
            .warn(format!("server {server} is not used: {reason}"));
        let jobs = self.fleet.refuse(server, reason);
        self.fail_jobs(jobs, Cause::server(reason, Blame::None), now);
    }

    /// Handles a fitness. `payload` is the raw message, used to explain why a metric is missing.
    pub(crate) fn fitness(&mut self, message: &Fitness, payload: &[u8], now: Instant) {
        let title = message.simulation.as_deref();
        if self.is_of_another(Topic::Fitness, title, &message.simulation_hash) {
            return;
        }
        let Some(run) = self.in_flight.end_episode(&message.simulation_hash, true) else {
            return self.unexpected_fitness(&message.simulation_hash, message.fitness);
        };
        self.in_flight
            .answered_with(&message.simulation_hash, message.fitness);
        let job = Job::Episode(message.simulation_hash.clone());
        self.fleet.finished(run.server, &job);
        self.answered_after(run.server, now.saturating_duration_since(run.heard()));
        let duration = now.saturating_duration_since(run.started);
        self.fleet.did_well(run.server, 1, duration.as_secs_f64());
        self.fleet.measured_episode(run.server, duration);
        self.fleet.heard(run.server, now);
        let value = |name: &str| message.metrics.get(name).copied();
        let names = &self.config.demand.metrics;
        let wrong = |name| Fitness::wrong_metric(payload, name);
        let metrics = needed(names, value).map_err(|missing| {
            let wrong = names.iter().find_map(|name| wrong(name));
            wrong.map_or(missing, |wrong| {
                format!("a metric that the fitness needs cannot be used: {wrong}")
            })
        });
        match metrics {
            Ok(metrics) => {
                self.record_run(&run, Outcome::Done, None, None, now);
                let evaluation = run.piece.first();
                let result = ServerResult::new(run.server, message.fitness, metrics);
                self.settle(&run.piece, evaluation, result, now);
            }
            Err(reason) => {
                self.record_run(&run, Outcome::Unusable, Some(reason.clone()), None, now);
                self.retry(run.piece, run.server, &reason, Blame::Evaluation, now);
            }
        }
        self.dispatch(now);
    }

    /// Handles a message that violates the protocol. If it names an episode of this tool, the server gets little time
    /// to send a valid one; a message that is too large is final.
    pub(crate) fn undecodable(
        &mut self,
        topic: &str,
        payload: &[u8],
        error: &DecodeError,
        now: Instant,
    ) {
        let reason = format!("message on {topic}: {error}");
        // Group by error, since no two invalid messages of a peer may be equal.
        self.outbox.warn_grouped(
            format!("{topic} {}", error.key()),
            format!("refusing a {reason}"),
        );
        let Some(hash) = self.in_flight.named_in(payload) else {
            return;
        };
        if let Some(run) = self.in_flight.episode_mut(&hash) {
            if matches!(error, DecodeError::TooLarge { .. }) {
                let server = run.server;
                self.end_run(server, &hash);
                return self.not_for(server, &reason, now);
            }
            run.refuse(reason, now);
        }
    }

    /// Ends an episode without fitness; see [`retry`](Self::retry).
    pub(crate) fn fail_episode(&mut self, hash: &str, cause: Cause<'_>, now: Instant) {
        let Some(run) = self.in_flight.end_episode(hash, false) else {
            return;
        };
        self.fleet
            .finished(run.server, &Job::Episode(hash.to_owned()));
        let blame = if run.begun() {
            cause.blame.of_begun(false)
        } else {
            cause.blame
        };
        let reason = cause.reason;
        self.record_run(&run, cause.outcome, Some(reason.to_owned()), None, now);
        self.retry(run.piece, run.server, reason, blame, now);
    }

    /// Handles an episode that failed in the simulation's code. The server continues, and the episode is retried.
    pub(crate) fn episode_failed(&mut self, message: Failed, now: Instant) {
        let hash = message.simulation_hash;
        let Some(run) = self.in_flight.episode(&hash) else {
            return;
        };
        if run.server != message.server {
            return;
        }
        if message.invalid {
            let reason = shortened(message.reason, MOST_REASON);
            return self.not_for(message.server, &reason, now);
        }
        let Some(run) = self.in_flight.end_episode(&hash, false) else {
            return;
        };
        self.fleet.spoke(run.server);
        self.fleet.finished(run.server, &Job::Episode(hash));
        let (reason, stack) = self
            .outbox
            .episode_failed(run.server, message.reason, message.stack);
        self.record_run(&run, Outcome::Failed, Some(reason.clone()), stack, now);
        self.retry(run.piece, run.server, &reason, Blame::Evaluation, now);
    }

    /// Hands back the episodes that have not begun on servers busy for an unnamed tool, which must be another one.
    fn taken_episodes(&mut self, now: Instant) {
        for (hash, server) in self.in_flight.taken_episodes(now) {
            self.fleet.remove(server);
            let reason = format!("server {server} is taken by another optimization tool");
            self.fail_episode(&hash, Cause::handed_back(&reason), now);
            self.dispatch(now);
        }
    }

    /// Hands back the episodes that have not begun on servers that are free.
    fn vacant_episodes(&mut self, now: Instant) {
        for (hash, server) in self.in_flight.vacant_episodes(now) {
            self.preempted(server, &hash, now);
        }
    }

    fn preempted(&mut self, id: u64, hash: &str, now: Instant) {
        let reason = format!("server {id} is free but has not begun the episode");
        let server_fault = self.fleet.was_preempted(id) > MOST_PREEMPTIONS;
        let cause = if server_fault {
            self.failed(id, &reason, now);
            Cause::server(&reason, Blame::Lost)
        } else {
            Cause::handed_back(&reason)
        };
        self.fail_episode(hash, cause, now);
        self.dispatch(now);
    }

    /// Handles the episodes whose servers have been silent for too long, or sent no valid message after a refusal.
    pub(crate) fn late_episodes(&mut self, now: Instant) {
        self.taken_episodes(now);
        self.vacant_episodes(now);
        for hash in self.in_flight.late_episodes(&self.config, now) {
            let Some(run) = self.in_flight.episode_mut(&hash) else {
                continue;
            };
            if self.processes.are_watched(run.server) && run.asks_supervisor() {
                self.outbox.push(Action::Overdue(run.server));
                continue;
            }
            let (server, heard) = (run.server, run.heard());
            let was_refused = run.refusal().is_some();
            let reason = run.overdue(&self.config.timeouts, now);
            let retry = self.fleet.describe_retry(server);
            self.outbox
                .warn(format!("{reason}; the episode is tried again{retry}"));
            self.end_run(server, &hash);
            let blame = if was_refused {
                Blame::Answer
            } else {
                self.counts.time_outs += 1;
                self.fleet.fell_silent(server);
                let others = self.fleet.anyone_spoke(heard, now);
                Blame::Silent { others }
            };
            self.failed_in_vain(server, &reason, now);
            self.fail_episode(&hash, Cause::server(&reason, blame), now);
        }
    }

    pub(crate) fn record_run(
        &mut self,
        run: &Episode,
        outcome: Outcome,
        error: Option<String>,
        stack: Option<String>,
        now: Instant,
    ) {
        let attempt = Attempt {
            mode: Mode::Stepwise.name(),
            server: run.server,
            steps: Some(run.steps()),
            outcome,
            error,
            stack,
            ..Attempt::default()
        };
        self.record(attempt, &run.piece, run.started, now);
    }

    /// Tells a server to end an episode.
    pub(crate) fn end_run(&mut self, server: u64, hash: &str) {
        self.control(server, hash.to_owned(), false);
    }
}
