//! Batched evaluation: controllers stay in this process; one message carries a step of all agents of many episodes.

use std::time::Instant;

use swarmwright_protocol::{
    BatchActuators, BatchSensors, BatchStart, EXTENSION_VERSION, F32s, ToServer, U64s,
};

use crate::journal::Outcome;
use crate::scheduler::Scheduler;
use crate::scheduler::job::Job;
use crate::scheduler::modes::batch::Batch;
use crate::scheduler::queue::piece::Piece;
use crate::scheduler::queue::results::ServerResult;

impl Scheduler {
    pub(crate) fn start_batch(&mut self, piece: Piece, server: u64, now: Instant) {
        let Some(work) = self.ledger.work() else {
            return;
        };
        let episodes = work.episodes();
        let controllers: Result<Vec<_>, _> = piece
            .evaluations
            .clone()
            .map(|evaluation| work.controller(evaluation / episodes))
            .collect();
        let controllers = match controllers {
            Ok(controllers) => controllers,
            Err(_) => return self.give_up(&piece, true, now),
        };
        let seeds = piece.evaluations.clone();
        let message = ToServer::Start(BatchStart {
            version: EXTENSION_VERSION,
            request: self.in_flight.next_request(),
            tool: self.config.tool.clone(),
            reply: self.messages.reply().to_owned(),
            simulation: self.config.demand.simulation.clone(),
            // All episodes of a batch share one parameter set, see `most`.
            parameters: match controllers.first() {
                Some(controller) => controller.merged(&self.config.parameters).into_owned(),
                None => self.config.parameters.clone(),
            },
            seeds: U64s(
                seeds
                    .map(|evaluation| work.seeds()[evaluation % episodes])
                    .collect(),
            ),
            metrics: self.config.demand.metrics.clone(),
            instance: self.fleet.instance(server),
        });
        let metrics = self.config.demand.metrics.clone();
        // If agents steer themselves, the first message comes when all episodes are over.
        let episodes = if work.architecture().steers() {
            1
        } else {
            u32::try_from(piece.len()).unwrap_or(u32::MAX)
        };
        let patience = self.config.timeouts.step.saturating_mul(episodes);
        let batch = Batch::new(controllers, self.messages.agents(), metrics);
        self.request(&message, piece, server, patience, Some(batch), now);
    }

    /// Ends a batch that a server steps although nobody waits for it, because its start arrived late or twice.
    pub(super) fn end_stray_batch(&mut self, message: &BatchSensors) {
        if !message.episodes.0.is_empty() {
            self.end_batch(message.server, message.request, message.step);
        }
    }

    /// Ends a batch at `step` by sending no actuators.
    pub(crate) fn end_batch(&mut self, server: u64, request: u64, step: u64) {
        let end = ToServer::Actuators(BatchActuators {
            version: EXTENSION_VERSION,
            request,
            step,
            actuators: F32s(Vec::new()),
        });
        self.ask(server, request, &end);
    }

    pub(super) fn stepped(&mut self, number: u64, message: BatchSensors, now: Instant) {
        let Some(mut request) = self.in_flight.take_request(number) else {
            return;
        };
        let server = request.server;
        let Some(batch) = &mut request.batch else {
            return;
        };
        let progress = match batch.step(message) {
            Ok(Some(progress)) => progress,
            Ok(None) => {
                self.in_flight.put_back_request(number, request);
                return;
            }
            Err(reason) if !batch.steers() => {
                self.in_flight.put_back_request(number, request);
                self.let_go(server);
                return self.not_for(server, &reason, now);
            }
            Err(reason) => {
                self.in_flight.put_back_request(number, request);
                return self.misbehaved(server, &reason, now);
            }
        };
        let since = now.saturating_duration_since(request.heard());
        self.fleet.measured_step(server, since);
        request.hear(now);
        for (index, reason, stack) in progress.failed {
            self.fail_one(&request, index, reason, stack, now);
            request.set_apart(request.piece.first() + index);
        }
        for (index, fitness, metrics) in progress.ended {
            let evaluation = request.piece.first() + index;
            let result = ServerResult::new(server, fitness, metrics);
            self.settle(&request.piece, evaluation, result, now);
        }
        if let Some((step, actuators)) = progress.answer {
            let answer = ToServer::Actuators(BatchActuators {
                version: EXTENSION_VERSION,
                request: number,
                step,
                actuators: F32s(actuators),
            });
            self.in_flight.put_back_request(number, request);
            self.ask(server, number, &answer);
            return;
        }
        self.fleet.finished(server, &Job::Request(number));
        let seconds = now.saturating_duration_since(request.started);
        let count = request.piece.len();
        if !request.all_failed() {
            self.fleet.did_well(server, count, seconds.as_secs_f64());
        }
        self.record_request(&request, Outcome::Done, None, now);
        self.limits.went_through(&request);
    }
}
