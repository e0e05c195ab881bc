//! Offloaded evaluation: the requests of one tool are computed one after another.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use serde_json::Value;
use swarmwright_controllers::Architecture;
use swarmwright_protocol::{
    DecodeError, EXTENSION_VERSION, Envelope, Evaluate, Evaluated, F64s, MAX_BLOCK, Refusal,
    RefusalKind, ToTool,
};

use super::{Action, Machine, State};
use crate::batch::answer;
use crate::genomes::Genomes;
use crate::job::{Done, Evaluation, Job, Request, Setup, invalid, metrics_wanted};

/// Largest number of waiting requests, and of the bytes that they hold.
const MOST_WAITING: usize = 4096;
const MOST_BYTES: usize = 4 * MAX_BLOCK;
/// Largest number of values in an answer: fitness and metrics of every episode, and as many again for reasons.
const MOST_NUMBERS: usize = MAX_BLOCK / 8;
/// Longest lease in seconds that is enforced.
const LONGEST_LEASE: f64 = 1e6;

/// Requests of the tool that has the server.
pub(crate) struct Work {
    /// The tool; `None` after the work was given up, until the next request.
    tool: Option<String>,
    /// Number of the request that is being computed.
    request: u64,
    abort: Arc<AtomicBool>,
    waiting: VecDeque<Request>,
    bytes: usize,
    /// Whether the current computation is being stopped because no tool waits for it.
    given_up: bool,
}

impl Work {
    pub fn holder(&self) -> Option<String> {
        self.tool.clone()
    }

    /// Returns whether a request is being computed, or waits.
    fn has(&self, tool: &str, request: u64) -> bool {
        let mut waiting = self.waiting.iter();
        let computed = !self.given_up && self.request == request;
        self.tool.as_deref() == Some(tool)
            && (computed || waiting.any(|other| other.number == request))
    }

    pub fn release(&mut self) {
        self.tool = None;
        self.given_up = true;
        self.abort.store(true, Ordering::Relaxed);
        self.waiting.clear();
        self.bytes = 0;
    }

    /// Takes the waiting requests.
    pub fn drain(&mut self) -> VecDeque<Request> {
        self.bytes = 0;
        std::mem::take(&mut self.waiting)
    }

    pub fn taken(&self, tool: &str) -> Option<Refusal> {
        let other = self.tool.as_deref().filter(|holder| *holder != tool);
        let reason = if let Some(other) = other {
            format!("taken by {other}")
        } else if self.waiting.len() >= MOST_WAITING || self.bytes >= MOST_BYTES {
            format!("{} requests of this tool are waiting", self.waiting.len())
        } else {
            return None;
        };
        Some(Refusal {
            kind: RefusalKind::Taken,
            reason,
        })
    }
}

impl Machine {
    pub(super) fn evaluate(&mut self, message: Evaluate, now: Instant) {
        if !self.can_reply(&message.reply) {
            return;
        }
        let (number, reply) = (message.request, message.reply.clone());
        if !self.is_meant(message.instance.as_ref()) {
            if let Some(refusal) = self.refuse_for_another(&message.simulation) {
                self.send_result(number, reply, &[], Err(refusal), 0.0);
            }
            return;
        }
        let tool = message.tool.clone();
        if let State::Working(work) = &self.state
            && work.has(&tool, number)
        {
            // The message is a duplicate.
            return;
        }
        let accepted = match self.taken(&tool) {
            Some(refusal) => Err(refusal),
            None => self.check(message, now).inspect_err(|refusal| {
                self.complain(format!(
                    "refusing an evaluation for {tool}: {}",
                    refusal.reason
                ));
            }),
        };
        match (accepted, &mut self.state) {
            (Ok(request), State::Working(work)) => {
                work.bytes += request.size();
                work.waiting.push_back(request);
                if work.tool.is_none() {
                    // The computation that was given up stops in a moment; this request follows.
                    work.tool = Some(tool);
                    self.turns.held_by(self.occupant(), true, now);
                    self.changed_at.get_or_insert(now);
                }
            }
            (Ok(request), _) => {
                let abort = self.compute(request);
                let work = Work {
                    tool: Some(tool),
                    request: number,
                    abort,
                    waiting: VecDeque::new(),
                    bytes: 0,
                    given_up: false,
                };
                self.enter(State::Working(work), now);
            }
            (Err(refusal), _) => self.send_result(number, reply, &[], Err(refusal), 0.0),
        }
    }

    /// Answers a message that cannot be decoded completely, if its reply topic can.
    pub(super) fn refuse_unread(&mut self, payload: &[u8], error: &DecodeError) {
        let Some(Envelope {
            kind,
            request,
            reply,
        }) = Envelope::decode(payload)
        else {
            return;
        };
        if !matches!(kind.as_str(), "evaluate" | "start") || !self.can_reply(&reply) {
            return;
        }
        let refusal = invalid(error.to_string());
        if kind == "evaluate" {
            self.send_result(request, reply, &[], Err(refusal), 0.0);
        } else {
            let mut message = answer(request, self.identity.id, 0);
            message.error = Some(refusal);
            self.send_sensors(reply, message);
        }
    }

    /// Returns the index of a simulation by its title.
    pub(super) fn offered(&self, title: &str) -> Result<usize, Refusal> {
        let position = self
            .offers
            .iter()
            .position(|offer| offer.description.title == title);
        position.ok_or_else(|| {
            invalid(format!(
                "simulation: {title:?} is not offered here, only {}",
                self.titles().join(", ")
            ))
        })
    }

    /// Checks a request before it is computed.
    fn check(&mut self, mut message: Evaluate, now: Instant) -> Result<Request, Refusal> {
        let before = self.setup.clone();
        let setup = self.setup(&mut message)?;
        let shared = before.is_some_and(|before| Arc::ptr_eq(&before, &setup));
        let weights = setup.architecture.weight_count();
        let genomes = Genomes::new(message.genomes.0, message.sample, weights).map_err(invalid)?;
        let (candidates, episodes) = (genomes.candidates(weights), message.seeds.0.len());
        if candidates.saturating_mul(episodes) > MOST_NUMBERS / (2 + setup.wanted.len()) {
            return Err(invalid(format!(
                "genomes: {candidates} candidates in {episodes} episodes are too many for one answer; send fewer at once"
            )));
        }
        let held = if shared { 0 } else { setup.bytes() };
        Ok(Request {
            number: message.request,
            reply: message.reply,
            setup,
            genomes,
            seeds: message.seeds.0,
            held,
            expires: (message.lease > 0.0 && message.lease < LONGEST_LEASE)
                .then(|| now + Duration::from_secs_f64(message.lease)),
        })
    }

    /// Returns the setup of a request; the same object as for the previous request, if they are equal.
    fn setup(&mut self, message: &mut Evaluate) -> Result<Arc<Setup>, Refusal> {
        let index = self.offered(&message.simulation)?;
        if let Some(setup) = &self.setup
            && setup.simulation == index
            && setup.controller.as_object() == Some(&message.controller)
            && setup.parameters == message.parameters
            && setup.metrics == message.metrics
        {
            return Ok(Arc::clone(setup));
        }
        let controller = Value::Object(std::mem::take(&mut message.controller));
        let text = controller.to_string();
        let architecture =
            Architecture::from_json(&text).map_err(|error| invalid(error.to_string()))?;
        if architecture.in_python().is_some() && self.identity.modules.is_empty() {
            return Err(invalid(
                "controller.kind: this server has no behaviours and conditions in Python; start it with --modules".to_owned(),
            ));
        }
        let description = &self.offers[index]
            .described(&message.parameters)
            .map_err(|error| invalid(error.to_string()))?;
        let steers = architecture.steers();
        for (field, actual, expected) in [
            ("sensors", architecture.sensors(), description.sensors),
            ("actuators", architecture.actuators(), description.actuators),
        ] {
            if steers && actual != expected {
                return Err(invalid(format!(
                    "controller.{field}: {actual}, but simulation {} has {expected}",
                    description.title
                )));
            }
        }
        let metrics = metrics_wanted(description, &message.metrics)?;
        let setup = Arc::new(Setup {
            simulation: index,
            controller,
            architecture,
            parameters: std::mem::take(&mut message.parameters),
            metrics: message.metrics.clone(),
            wanted: metrics,
        });
        self.setup = Some(Arc::clone(&setup));
        Ok(setup)
    }

    /// Passes a request and its simulation to the evaluator.
    fn compute(&mut self, request: Request) -> Arc<AtomicBool> {
        let abort = Arc::new(AtomicBool::new(false));
        // The simulation is available, since no other job, batch or run is in progress.
        if let Some(simulation) = self.offers[request.setup.simulation].simulation.take() {
            self.actions.push(Action::Evaluate(Job {
                request,
                simulation,
                abort: Arc::clone(&abort),
            }));
        }
        abort
    }

    /// Handles a job that has been computed, and starts the next one.
    pub fn finished(&mut self, done: Done, now: Instant) {
        let Done {
            request,
            simulation,
            result,
            seconds,
        } = done;
        self.offers[request.setup.simulation].simulation = Some(simulation);
        let State::Working(work) = &mut self.state else {
            return;
        };
        let Some(tool) = work.tool.clone() else {
            return self.enter(State::Free, now);
        };
        if std::mem::take(&mut work.given_up) {
            return self.next_request(now);
        }
        if let Err(refusal) = &result {
            self.complain(format!(
                "refusing an evaluation for {tool}: {}",
                refusal.reason
            ));
        }
        let metrics = &request.setup.metrics;
        self.send_result(request.number, request.reply, metrics, result, seconds);
        self.next_request(now);
    }

    fn next_request(&mut self, now: Instant) {
        if self.turn_ends(now) {
            return;
        }
        while let State::Working(work) = &mut self.state {
            let Some(request) = work.waiting.pop_front() else {
                return self.leave(now);
            };
            work.bytes -= request.size();
            if request.expires.is_some_and(|at| at <= now) {
                let refusal = Refusal {
                    kind: RefusalKind::Failed,
                    reason: "the lease ran out before its turn came".to_owned(),
                };
                self.send_result(request.number, request.reply, &[], Err(refusal), 0.0);
                continue;
            }
            let number = request.number;
            let abort = self.compute(request);
            if let State::Working(work) = &mut self.state {
                work.request = number;
                work.abort = abort;
            }
            return;
        }
    }

    pub(super) fn send_result(
        &mut self,
        request: u64,
        topic: String,
        metrics: &[String],
        result: Result<Evaluation, Refusal>,
        seconds: f64,
    ) {
        let encode = |result: Result<Evaluation, Refusal>| {
            let (evaluation, error) = match result {
                Ok(evaluation) => (evaluation, None),
                Err(refusal) => (Evaluation::default(), Some(refusal)),
            };
            let named = metrics.iter().cloned();
            ToTool::Evaluated(Evaluated {
                version: EXTENSION_VERSION,
                request,
                server: self.identity.id,
                fitness: F64s(evaluation.fitness),
                metrics: named
                    .zip(evaluation.metrics.into_iter().map(F64s))
                    .collect(),
                failed: evaluation.failed,
                error,
                seconds,
            })
            .encode()
        };
        let mut payload = encode(result);
        if payload.len() > MAX_BLOCK {
            payload = encode(Err(Refusal {
                kind: RefusalKind::Failed,
                reason: format!(
                    "the answer is longer than {MAX_BLOCK} bytes; send fewer candidates at once"
                ),
            }));
        }
        self.actions.push(Action::Reply {
            topic,
            request: Some(request),
            payload,
        });
    }
}
