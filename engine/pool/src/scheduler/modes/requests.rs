//! Work that goes to a server in one piece: blocks for offloaded evaluation, batches of episodes (DESIGN.md section 4).

use std::time::{Duration, Instant};

use swarmwright_protocol::{
    BatchActuators, BatchSensors, BatchStart, EXTENSION_VERSION, Evaluate, Evaluated, F32s,
    Refusal, RefusalKind, ToServer, ToTool, U64s,
};

use crate::journal::Attempt;
use crate::metrics::needed;
use crate::scheduler::job::Job;
use crate::scheduler::modes::batch::Batch;
use crate::scheduler::modes::request::Request;
use crate::scheduler::queue::blame::Blame;
use crate::scheduler::queue::piece::Piece;
use crate::scheduler::queue::results::Found;
use crate::scheduler::{Action, Scheduler};
use crate::work::Work;

/// A block is given to somebody else when it takes this many times as long as expected.
const LEASE: f64 = 10.0;
/// How often a block is given more time since it was not answered in time.
const MOST_LATE: u32 = 3;

impl Scheduler {
    /// Bytes of a request for a block of the work without genomes and seeds.
    pub(crate) fn beside(&self, work: &Work) -> usize {
        let nothing = Evaluate {
            version: EXTENSION_VERSION,
            request: u64::MAX,
            tool: self.config.tool.clone(),
            reply: self.messages.reply().to_owned(),
            simulation: self.config.demand.simulation.clone(),
            parameters: self.config.parameters.clone(),
            controller: work.specification().clone(),
            genomes: F32s::default(),
            seeds: U64s::default(),
            metrics: self.config.demand.metrics.clone(),
            attempt: u32::MAX,
            lease: 0.5,
            instance: None,
        };
        ToServer::Evaluate(nothing).encode().len()
    }

    pub(crate) fn send_block(&mut self, piece: Piece, server: u64, now: Instant) {
        let (candidates, episodes) = self.ledger.extent(&piece);
        let Some(work) = self.ledger.work() else {
            return;
        };
        let rate = self.fleet.slot(server).and_then(|slot| slot.rate);
        #[expect(
            clippy::cast_precision_loss,
            reason = "far fewer than 2^53 evaluations"
        )]
        let expected = rate.map_or(0.0, |rate| LEASE * piece.len() as f64 / rate);
        // A server may have become slower than it was when it was measured.
        let more = 4f64.powi(i32::try_from(piece.late.min(MOST_LATE)).unwrap_or(0));
        let lease = self.config.step_timeout.as_secs_f64().max(expected) * more;
        let message = ToServer::Evaluate(Evaluate {
            version: EXTENSION_VERSION,
            request: self.in_flight.next_request(),
            tool: self.config.tool.clone(),
            reply: self.messages.reply().to_owned(),
            simulation: self.config.demand.simulation.clone(),
            parameters: self.config.parameters.clone(),
            controller: work.specification().clone(),
            genomes: F32s(work.genomes_of(candidates).to_vec()),
            seeds: U64s(work.seeds()[episodes].to_vec()),
            metrics: self.config.demand.metrics.clone(),
            attempt: piece.tries + 1,
            // What was sent before this one is computed first. Who is watched is ended where it takes too long.
            lease: if self.processes.are_watched(server) {
                0.0
            } else {
                lease * 2.0
            },
            instance: self.fleet.instance(server),
        });
        let lease = Duration::try_from_secs_f64(lease).unwrap_or(self.config.step_timeout);
        self.request(&message, piece, server, lease, None, now);
    }

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
            // Of a parameter set all episodes of a batch have the same values, see `most`.
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
        // Agents that steer themselves are not heard of before all episodes are over.
        let episodes = if work.architecture().steers() {
            1
        } else {
            u32::try_from(piece.len()).unwrap_or(u32::MAX)
        };
        let patience = self.config.step_timeout.saturating_mul(episodes);
        let batch = Batch::new(controllers, self.messages.agents(), metrics);
        self.request(&message, piece, server, patience, Some(batch), now);
    }

    fn request(
        &mut self,
        message: &ToServer,
        piece: Piece,
        server: u64,
        lease: Duration,
        batch: Option<Batch>,
        now: Instant,
    ) {
        let request = Request::new(piece, server, lease, batch, now);
        let number = self.in_flight.begin_request(request);
        self.ask(server, number, message);
        self.fleet.began(server, Job::Request(number));
    }

    /// A request was not sent: a broker that takes so little takes it from no server.
    pub(crate) fn unsent(&mut self, number: u64, reason: &str, now: Instant) {
        self.fail_request(number, reason, Blame::Evaluation, now);
        self.dispatch(now);
    }

    fn ask(&mut self, server: u64, request: u64, message: &ToServer) {
        let payload = message.encode();
        let asked = self.in_flight.request(request);
        if asked.is_some_and(|request| request.piece.len() == 1) {
            self.limits.sent_whole(payload.len());
        }
        self.outbox.push(Action::Request {
            server,
            request,
            payload,
        });
    }

    /// A message for this tool came in. What is not waited for any more is passed over.
    pub(crate) fn answered(&mut self, message: ToTool, now: Instant) {
        let before = self.changes();
        self.answer(message, now);
        // Most steps end nothing, and thousands of them come each second.
        if self.changes() != before {
            self.tell_of_limits();
            self.dispatch(now);
        }
    }

    /// What is different where there is something to give away, or somebody to give it to.
    fn changes(&self) -> (usize, usize, usize) {
        (self.journal.len(), self.ledger.queued(), self.fleet.woken())
    }

    fn answer(&mut self, message: ToTool, now: Instant) {
        match message {
            ToTool::Evaluated(message) => {
                let number = message.request;
                match (
                    self.is_batch(number, message.server, message.fitness.0.len(), now),
                    &message.error,
                ) {
                    (Some(_), Some(refusal)) => self.refused(number, message.server, refusal, now),
                    (Some(false), None) => self.evaluated(number, message, now),
                    _ => {}
                }
            }
            ToTool::Sensors(message) => {
                let number = message.request;
                match (
                    self.is_batch(number, message.server, message.ended.0.len(), now),
                    &message.error,
                ) {
                    (Some(_), Some(refusal)) => self.refused(number, message.server, refusal, now),
                    (Some(true), None) => self.stepped(number, message, now),
                    (None, None) => self.end_ghost(&message),
                    _ => {}
                }
            }
            ToTool::Failed(message) => self.episode_failed(message, now),
        }
    }

    /// Whether a request is one for a batch; none if this server was not asked, or not any more: its `results` are late.
    fn is_batch(&mut self, number: u64, server: u64, results: usize, now: Instant) -> Option<bool> {
        let Some(request) = self.in_flight.request(number) else {
            self.counts.late += u64::from(results > 0);
            return None;
        };
        let is_batch = request.batch.is_some();
        if request.server != server {
            return None;
        }
        self.fleet.answered_request(server, now);
        Some(is_batch)
    }

    /// A server steps a batch that nobody waits for: its start came late or twice.
    fn end_ghost(&mut self, message: &BatchSensors) {
        if !message.episodes.0.is_empty() {
            self.end_batch(message.server, message.request, message.step);
        }
    }

    /// Ends a batch: there are no actuators for its `step`.
    pub(crate) fn end_batch(&mut self, server: u64, request: u64, step: u64) {
        let end = ToServer::Actuators(BatchActuators {
            version: EXTENSION_VERSION,
            request,
            step,
            actuators: F32s(Vec::new()),
        });
        self.ask(server, request, &end);
    }

    fn evaluated(&mut self, number: u64, message: Evaluated, now: Instant) {
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
        let (count, since) = (
            request.piece.len(),
            now.saturating_duration_since(request.heard),
        );
        // A server's own word for it, as far as it can be true.
        let told = message.seconds.is_finite() && message.seconds > 0.0;
        // Not since the reply before: where two are read at once, that is no time at all.
        let most = now.saturating_duration_since(request.started);
        let seconds = if told {
            message.seconds.min(most.as_secs_f64())
        } else {
            since.as_secs_f64()
        };
        // How fast a server fails tells nothing of how fast it is.
        if message.failed.len() < count {
            self.fleet.did_well(request.server, count, seconds);
        }
        if let Some(slot) = self.fleet.slot(request.server) {
            for job in &slot.jobs {
                if let Job::Request(next) = job
                    && let Some(next) = self.in_flight.request_mut(*next)
                {
                    next.heard = now;
                }
            }
        }
        self.record_request(&request, None, now);
        self.limits.went_through(&request);
        // What succeeded shows that the server is sound, so it comes last.
        let columns = self.ledger.extent(&request.piece).1.len();
        for failure in message.failed {
            let offset = usize::try_from(failure.candidate * columns as u64 + failure.episode);
            let offset = offset.unwrap_or(usize::MAX);
            self.fail_one(&request, offset, failure.reason, failure.stack, now);
        }
        for (offset, &fitness) in message.fitness.0.iter().enumerate() {
            if !fitness.is_finite() {
                continue;
            }
            let value = |name: &str| message.metrics.get(name)?.0.get(offset).copied();
            match needed(&metrics, value) {
                Ok(values) => {
                    let evaluation = request.piece.first() + offset;
                    let found = Found::new(request.server, fitness, values);
                    self.settle(&request.piece, evaluation, found, now);
                }
                Err(reason) => self.fail_one(&request, offset, reason, None, now),
            }
        }
    }

    fn stepped(&mut self, number: u64, message: BatchSensors, now: Instant) {
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
        let since = now.saturating_duration_since(request.heard);
        self.fleet.measured_step(server, since);
        request.heard = now;
        for (index, reason, stack) in progress.failed {
            self.fail_one(&request, index, reason, stack, now);
            request.apart.push(request.piece.first() + index);
        }
        for (index, fitness, metrics) in progress.ended {
            let evaluation = request.piece.first() + index;
            let found = Found::new(server, fitness, metrics);
            self.settle(&request.piece, evaluation, found, now);
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
        if request.apart.len() < count {
            self.fleet.did_well(server, count, seconds.as_secs_f64());
        }
        self.record_request(&request, None, now);
        self.limits.went_through(&request);
    }

    /// One evaluation of a request failed on a server that goes on.
    fn fail_one(
        &mut self,
        request: &Request,
        offset: usize,
        reason: String,
        stack: Option<String>,
        now: Instant,
    ) {
        let index = request.piece.first() + offset;
        let piece = request.piece.part(index..index + 1);
        let (reason, stack) = self.outbox.episode_failed(request.server, reason, stack);
        let attempt = Attempt {
            stack,
            ..request.attempt(Some(reason.clone()))
        };
        self.record(attempt, &piece, request.started, now);
        self.retry(piece, request.server, &reason, Blame::Evaluation, now);
    }

    /// A server does not do what it was asked for.
    fn refused(&mut self, number: u64, server: u64, refusal: &Refusal, now: Instant) {
        let reason = &refusal.reason;
        let jobs = match refusal.kind {
            // It waited in vain for this tool, or cannot do just this: nothing that the simulation said.
            RefusalKind::Failed => {
                let reason = format!("server {server}: {reason}");
                let blame = Blame::Silent { others: false };
                return self.fail_server(server, &reason, blame, now);
            }
            RefusalKind::Taken => self.fleet.remove(server),
            RefusalKind::Invalid => {
                self.outlook.refused(now);
                self.outbox
                    .warn(format!("server {server} refuses the work: {reason}"));
                self.fleet.refuse(server, reason)
            }
        };
        // Also where the server was given up meanwhile.
        self.fail_request(number, reason, Blame::Nobody, now);
        self.fail_jobs(jobs, reason, Blame::Nobody, now);
    }

    /// A request is over without a result; see [`retry`](Self::retry).
    pub(crate) fn fail_request(&mut self, number: u64, reason: &str, blame: Blame, now: Instant) {
        let Some(request) = self.in_flight.take_request(number) else {
            return;
        };
        let server = request.server;
        self.fleet.finished(server, &Job::Request(number));
        self.record_request(&request, Some(reason.to_owned()), now);
        let alone = request.piece.len() == 1;
        for piece in request.rest() {
            // What is left of several may have had company.
            let blame = match blame {
                Blame::Answer | Blame::Crash | Blame::Gone | Blame::Lost | Blame::Silent { .. }
                    if piece.len() == 1 && !alone =>
                {
                    Blame::Nobody
                }
                Blame::Lost => Blame::Gone,
                blame => blame,
            };
            self.retry(piece, server, reason, blame, now);
        }
    }

    pub(crate) fn record_request(
        &mut self,
        request: &Request,
        error: Option<String>,
        now: Instant,
    ) {
        let attempt = Attempt {
            steps: request.batch.as_ref().map(Batch::steps),
            ..request.attempt(error)
        };
        self.record(attempt, &request.piece, request.started, now);
    }

    /// Requests that have not been answered within their lease.
    pub(crate) fn late_requests(&mut self, now: Instant) {
        for number in self.in_flight.late_requests(now) {
            if let Some(request) = self.in_flight.request_mut(number) {
                if self.processes.are_watched(request.server) && !request.overdue {
                    request.overdue = true;
                    self.outbox.push(Action::Overdue(request.server));
                    continue;
                }
                let (server, heard) = (request.server, request.heard);
                let reason = request.waiting_for(now).to_string();
                self.counts.time_outs += 1;
                self.fleet.fell_silent(server);
                let others = self.fleet.anyone_spoke(heard, now);
                self.fail_server(server, &reason, Blame::Silent { others }, now);
            }
        }
    }

    /// A server sent what cannot be used.
    fn misbehaved(&mut self, server: u64, reason: &str, now: Instant) {
        let reason = format!("server {server}: {reason}");
        self.fail_server(server, &reason, Blame::Answer, now);
    }

    /// A server failed: the oldest of its jobs is held against it, all are tried elsewhere, and it has a pause.
    fn fail_server(&mut self, server: u64, reason: &str, blame: Blame, now: Instant) {
        self.outbox
            .warn(format!("{reason}; the work is tried again elsewhere"));
        self.let_go(server);
        self.failed(server, reason, now);
        let jobs = match self.fleet.slot(server) {
            Some(slot) => slot.jobs.clone(),
            None => Vec::new(),
        };
        self.fail_jobs(jobs, reason, blame, now);
    }
}

/// Why a result is not enough: a metric that is needed is not in it.
fn without(message: &Evaluated, metrics: &[String]) -> Option<String> {
    let missing = metrics
        .iter()
        .find(|name| !message.metrics.contains_key(*name))?;
    Some(format!("the metric {missing} is missing from the result"))
}

/// Why a result is none of this piece.
fn misfit(message: &Evaluated, piece: &Piece, episodes: usize) -> Option<String> {
    let (found, expected) = (message.fitness.0.len(), piece.len());
    if found != expected {
        return Some(format!("{found} fitness values came, expected {expected}"));
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
    // As many failures as fitness values that are none: that was seen to when the message was read.
    match failed {
        Some(failed) if failed.len() == message.failed.len() => None,
        _ => Some("the failed evaluations are not those without fitness".to_owned()),
    }
}
