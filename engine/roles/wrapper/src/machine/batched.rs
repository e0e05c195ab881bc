//! Batched evaluation: one message per step for all agents of all running episodes of a batch.

use std::time::Instant;

use swarmwright_protocol::{
    BatchActuators, BatchSensors, BatchStart, MAX_BLOCK, Refusal, RefusalKind, ToTool,
};
use swarmwright_worlds::Simulation;

use super::{Action, Machine, Offer, State};
use crate::batch::{Batch, answer};
use crate::guard::guarded;
use crate::job::invalid;

impl Machine {
    pub(super) fn start_batch(&mut self, message: BatchStart, now: Instant) {
        if !self.can_reply(&message.reply) {
            return;
        }
        let (request, reply) = (message.request, message.reply.clone());
        if !self.is_meant(message.instance.as_ref()) {
            if let Some(refusal) = self.refuse_for_another(&message.simulation) {
                let message = BatchSensors {
                    error: Some(refusal),
                    ..answer(request, self.identity.id, 0)
                };
                self.send_sensors(reply, message);
            }
            return;
        }
        let tool = message.tool.clone();
        if let State::Stepping(batch) = &self.state
            && (&batch.tool, batch.request) == (&tool, request)
        {
            // The message is a duplicate.
            return;
        }
        let started = match self.computing().or_else(|| self.taken(&tool)) {
            Some(refusal) => Err(refusal),
            None => self.prepare_batch(message, now).inspect_err(|refusal| {
                self.complain(format!("refusing a batch of {tool}: {}", refusal.reason));
            }),
        };
        match started {
            Ok(batch) => {
                self.enter(State::Stepping(Box::new(batch)), now);
                self.sense_batch(now);
            }
            Err(refusal) => {
                let message = BatchSensors {
                    error: Some(refusal),
                    ..answer(request, self.identity.id, 0)
                };
                self.send_sensors(reply, message);
            }
        }
    }

    /// Returns why a batch cannot begin, if a request is being computed.
    fn computing(&self) -> Option<Refusal> {
        let State::Working(work) = &self.state else {
            return None;
        };
        let reason = match work.holder() {
            Some(holder) => format!("computing an evaluation for {holder}"),
            None => "stopping an evaluation that was given up".to_owned(),
        };
        Some(Refusal {
            kind: RefusalKind::Taken,
            reason,
        })
    }

    fn prepare_batch(&mut self, message: BatchStart, now: Instant) -> Result<Batch, Refusal> {
        let index = self.offered(&message.simulation)?;
        let offer = &mut self.offers[index];
        let count = message.seeds.0.len();
        if count > offer.batch {
            return Err(invalid(format!(
                "seeds: {count} episodes, but a batch here has at most {}",
                offer.batch
            )));
        }
        let description = offer
            .described(&message.parameters)
            .map_err(|error| invalid(error.to_string()))?;
        let simulations = offer.gather(if offer.together { 1 } else { count })?;
        Batch::start(message, index, &description, simulations, now).map_err(
            |(refusal, simulations)| {
                self.offers[index].put_back(simulations);
                refusal
            },
        )
    }

    pub(super) fn take_back(&mut self, batch: Batch) {
        self.offers[batch.simulation].put_back(batch.into_simulations());
    }

    pub(super) fn step_batch(&mut self, message: &BatchActuators, now: Instant) {
        let State::Stepping(batch) = &mut self.state else {
            return;
        };
        if batch.request != message.request {
            let reason = format!(
                "refusing actuators of batch {}: batch {} of {} is under way",
                message.request, batch.request, batch.tool
            );
            return self.complain(reason);
        }
        if message.actuators.0.is_empty() {
            return self.leave(now);
        }
        match batch.actuate(message) {
            Ok(()) => self.sense_batch(now),
            Err(reason) => self.complain(format!("refusing the actuators of a batch: {reason}")),
        }
    }

    /// Sends the message for the step that begins; it is the last one if all episodes have ended. Simulations that need
    /// no actuators are stepped first, and again whenever the batch is resumed.
    pub(super) fn sense_batch(&mut self, now: Instant) {
        let server = self.identity.id;
        let State::Stepping(batch) = &mut self.state else {
            return;
        };
        if batch.go_on(now) {
            return;
        }
        let reply = batch.reply.clone();
        match batch.sense(server, now) {
            Ok(message) => {
                let over = batch.is_over();
                self.send_sensors(reply, message);
                if over {
                    self.leave(now);
                }
            }
            Err(refusal) => {
                let message = batch.refusal(server, refusal);
                self.send_sensors(reply, message);
                self.leave(now);
            }
        }
    }

    pub(super) fn give_up_batch(&mut self, words: String, now: Instant) {
        let server = self.identity.id;
        if let State::Stepping(batch) = &self.state {
            let reply = batch.reply.clone();
            let message = batch.refusal(
                server,
                Refusal {
                    kind: RefusalKind::Failed,
                    reason: words.clone(),
                },
            );
            self.send_sensors(reply, message);
        }
        self.warn(format!(
            "{words}; the batch is given up, the server is free again"
        ));
        self.enter(State::Free, now);
    }

    pub(super) fn send_sensors(&mut self, topic: String, message: BatchSensors) {
        let (request, server, step) = (message.request, message.server, message.step);
        let mut payload = ToTool::Sensors(message).encode();
        if payload.len() > MAX_BLOCK {
            payload = ToTool::Sensors(BatchSensors {
                error: Some(invalid(format!(
                    "seeds: a step makes a message of {} bytes, more than {MAX_BLOCK}; start fewer episodes at once",
                    payload.len()
                ))),
                ..answer(request, server, step)
            })
            .encode();
        }
        self.actions.push(Action::Reply {
            topic,
            request: Some(request),
            payload,
        });
    }
}

impl Offer {
    /// Collects `count` simulations: the offered one, spare ones, and new duplicates.
    fn gather(&mut self, count: usize) -> Result<Vec<Box<dyn Simulation>>, Refusal> {
        let mut simulations: Vec<_> = self.simulation.take().into_iter().collect();
        while simulations.len() < count {
            let another = match (self.spares.pop(), simulations.first()) {
                (Some(spare), _) => Some(spare),
                (None, Some(first)) => guarded(|| first.duplicate()).ok().flatten(),
                (None, None) => None,
            };
            let Some(another) = another else {
                let reason = format!(
                    "the simulation cannot be duplicated for {count} episodes; start fewer at once"
                );
                self.put_back(simulations);
                return Err(Refusal {
                    kind: RefusalKind::Failed,
                    reason,
                });
            };
            simulations.push(another);
        }
        Ok(simulations)
    }

    fn put_back(&mut self, simulations: Vec<Box<dyn Simulation>>) {
        let mut simulations = simulations.into_iter();
        self.simulation = self.simulation.take().or_else(|| simulations.next());
        self.spares.extend(simulations);
    }
}
