//! Offloaded evaluation: a block of controllers is sent to a server, which returns their results.

use std::time::{Duration, Instant};

use swarmwright_protocol::{Evaluate, Evaluated, F32s, ToServer, U64s};

use crate::journal::Outcome;
use crate::metrics::needed;
use crate::scheduler::Scheduler;
use crate::scheduler::fleet::slot::Slot;
use crate::scheduler::job::Job;
use crate::scheduler::queue::piece::Piece;
use crate::scheduler::queue::results::ServerResult;
use crate::work::Work;

impl Scheduler {
    /// Returns the bytes of a request for a block of the work without genomes and seeds.
    pub(crate) fn beside(&self, work: &Work) -> usize {
        let nothing = self.messages.block(&self.config, work);
        ToServer::Evaluate(nothing).encode().len()
    }

    pub(crate) fn send_block(&mut self, piece: Piece, server: u64, now: Instant) {
        let (candidates, episodes) = self.ledger.extent(&piece);
        let Some(work) = self.ledger.work() else {
            return;
        };
        let lease = self.view().lease(&piece, server);
        let makes_samples = self.fleet.slot(server).is_some_and(Slot::makes_samples);
        let sample = work.sample_of(&candidates).filter(|_| makes_samples);
        let genomes = match sample {
            Some(_) => Vec::new(),
            None => work.genomes_of(candidates).into_owned(),
        };
        let message = ToServer::Evaluate(Evaluate {
            request: self.in_flight.next_request(),
            genomes: F32s(genomes),
            sample,
            seeds: U64s(work.seeds()[episodes].to_vec()),
            attempt: piece.tries + 1,
            // The server computes earlier requests first, so the lease is doubled. A supervised server has none; its
            // process is ended instead.
            lease: if self.processes.are_watched(server) {
                0.0
            } else {
                lease * 2.0
            },
            instance: self.fleet.instance(server),
            ..self.messages.block(&self.config, work)
        });
        let lease = Duration::try_from_secs_f64(lease).unwrap_or(self.config.timeouts.step);
        self.request(&message, piece, server, lease, None, now);
    }

    pub(super) fn evaluated(&mut self, number: u64, message: Evaluated, now: Instant) {
        let Some(request) = self.in_flight.take_request(number) else {
            return;
        };
        let metrics = self.config.demand.metrics.clone();
        let reason = misfit(&message, &request.piece, self.ledger.episodes());
        if let Some(reason) = reason.or_else(|| without(&message, &metrics)) {
            let server = request.server;
            self.in_flight.put_back_request(number, request);
            return self.misbehaved(server, &reason, now);
        }
        self.fleet.finished(request.server, &Job::Request(number));
        let count = request.piece.len();
        if !message.seconds.is_finite() || message.seconds < 0.0 {
            // The text has no value in it, so that the warning is issued once per server.
            let defect = if message.seconds.is_finite() {
                "negative"
            } else {
                "NaN or infinite"
            };
            self.outbox.warn_once(format!(
                "ignoring \"seconds\" in answers of server {}: it is {defect}, expected the seconds of computation, 0 or more",
                request.server
            ));
        }
        let seconds = request.seconds(message.seconds, now);
        // The speed of failures says nothing about the speed of evaluations.
        let failed = message.failed.len();
        if failed < count {
            self.fleet.did_well(request.server, count, seconds);
        }
        if let Some(slot) = self.fleet.slot(request.server) {
            self.in_flight.may_begin(&slot.jobs, now);
        }
        self.record_request(&request, Outcome::Done, None, now);
        self.limits.went_through(&request);
        // Successes come last, because they confirm earlier failures.
        let columns = self.ledger.extent(&request.piece).1.len();
        for failure in message.failed {
            let offset = usize::try_from(failure.candidate * columns as u64 + failure.episode);
            let offset = offset.unwrap_or(usize::MAX);
            self.fail_one(&request, offset, failure.reason, failure.stack, now);
        }
        let finite = message.fitness.0.iter().enumerate();
        let finite = finite.filter(|(_, fitness)| fitness.is_finite());
        if metrics.is_empty() {
            // A block may hold thousands of evaluations, so the success of the server is recorded once.
            let times = u32::try_from(count - failed).unwrap_or(u32::MAX);
            if times > 0 {
                self.server_succeeded(request.server, times);
            }
            if failed == 0 && self.settle_whole(&request.piece, request.server, &message.fitness.0)
            {
                return;
            }
            for (offset, &fitness) in finite {
                let evaluation = request.piece.first() + offset;
                let result = ServerResult::new(request.server, fitness, Vec::new());
                self.settle_proven(&request.piece, evaluation, result, now);
            }
            return;
        }
        for (offset, &fitness) in finite {
            let value = |name: &str| message.metrics.get(name)?.0.get(offset).copied();
            match needed(&metrics, value) {
                Ok(values) => {
                    let evaluation = request.piece.first() + offset;
                    let result = ServerResult::new(request.server, fitness, values);
                    self.settle(&request.piece, evaluation, result, now);
                }
                Err(reason) => self.fail_one(&request, offset, reason, None, now),
            }
        }
    }
}

/// Returns an error if a required metric is missing in a result.
fn without(message: &Evaluated, metrics: &[String]) -> Option<String> {
    let missing = metrics
        .iter()
        .find(|name| !message.metrics.contains_key(*name))?;
    Some(format!("the metric {missing} is missing from the result"))
}

/// Returns why a result does not match this piece; `None` if it does.
fn misfit(message: &Evaluated, piece: &Piece, episodes: usize) -> Option<String> {
    let (actual, expected) = (message.fitness.0.len(), piece.len());
    if actual != expected {
        return Some(format!(
            "{actual} fitness values arrived, expected {expected}"
        ));
    }
    let columns = piece.len().min(episodes) as u64;
    let is_failed = |candidate: u64, episode: u64| {
        let offset = candidate.checked_mul(columns)?.checked_add(episode)?;
        let value = message.fitness.0.get(usize::try_from(offset).ok()?)?;
        (episode < columns && !value.is_finite()).then_some(offset)
    };
    let failed: Option<std::collections::BTreeSet<u64>> = message
        .failed
        .iter()
        .map(|failure| is_failed(failure.candidate, failure.episode))
        .collect();
    // The decoder has already checked that there are as many failures as missing fitness values.
    match failed {
        Some(failed) if failed.len() == message.failed.len() => None,
        _ => Some("the failed evaluations must be those without fitness".to_owned()),
    }
}
