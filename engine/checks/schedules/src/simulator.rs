//! Virtual time: what happens next, and whether it may.

pub(crate) mod properties;

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use crate::client::Client;
use crate::network::{Network, Packet};
use crate::random::mix;
use crate::schedule::{Disturbance, MILLI, SECOND, Schedule, Time};
use crate::server::Server;
use crate::tool::{Stage, Tool};

/// Interval between checks whether a server is idle or a tool stores too much.
const LOOK: Time = 250 * MILLI;
/// After the last disturbance, work ends within this time and what it takes to compute everything a few times.
pub const RECOVERY: Time = 600 * SECOND;
/// How long a server pauses that fails again and again.
const LONGEST_BENCH: Time = 60 * SECOND;
/// Events of a simulation; more are an endless loop.
const MOST_EVENTS: u64 = 3_000_000;
/// Lines of a log that is shown.
const LOG: usize = 20_000;

/// What happens at a time.
#[derive(Debug, Clone)]
pub(crate) enum Event {
    /// A packet arrives at the broker or at a client.
    Arrive {
        connection: usize,
        up: bool,
        packet: Packet,
    },
    /// A machine's timer.
    Timer { who: usize, incarnation: u64 },
    /// A server has computed a job.
    Done {
        who: usize,
        incarnation: u64,
        job: u64,
        took: Time,
    },
    /// A client tries to connect.
    Connect { who: usize, incarnation: u64 },
    /// A tool submits its next work.
    Submit { who: usize, incarnation: u64 },
    /// A process starts, unless it runs.
    Start { who: usize },
    /// Nothing was heard of a client for long, for the cause of this number.
    Silence { connection: usize, cause: usize },
    /// A client has heard nothing for long, for the cause of this number.
    GiveUp { connection: usize, cause: usize },
    /// A disturbance.
    Begin(usize),
    /// Its end.
    End(usize),
    /// The broker saves what is retained.
    Save,
    /// Time to look.
    Look,
}

/// How a simulation went.
#[derive(Debug, Clone)]
pub struct Report {
    /// Which property does not hold.
    pub violation: Option<String>,
    /// Events.
    pub events: u64,
    /// When the last tool had everything.
    pub end: Time,
    /// The same for the same schedule and the same code.
    pub fingerprint: u64,
    /// Candidates that were scored.
    pub scored: usize,
    /// Evaluations that were reported failed although they could have been computed.
    pub failed: usize,
    /// Runs that ended without results, to be resumed.
    pub ended: usize,
    /// What happened, if it was asked for.
    pub log: Vec<String>,
}

pub(crate) struct Simulator<'a> {
    pub schedule: &'a Schedule,
    base: Instant,
    pub now: Time,
    agenda: BTreeMap<(Time, u64), Event>,
    serial: u64,
    events: u64,
    pub network: Network,
    pub clients: Vec<Client>,
    pub tools: Vec<Tool>,
    pub servers: Vec<Option<Server>>,
    /// The active disturbances, by number.
    pub active: Vec<(u64, Disturbance)>,
    /// Since when a server has nothing to do while a tool has work, by tool, server, and whether it is free.
    pub idle: BTreeMap<(usize, usize, bool), Time>,
    pub violation: Option<String>,
    fingerprint: u64,
    end: Time,
    log: Option<Vec<String>>,
}

/// Runs a schedule. `log`: whether what happens is to be written down.
#[must_use]
pub fn run(schedule: &Schedule, log: bool) -> Report {
    let mut simulator = Simulator::new(schedule, log);
    simulator.prepare();
    simulator.run();
    let tools = || simulator.tools.iter();
    Report {
        events: simulator.events,
        end: simulator.end,
        fingerprint: simulator.fingerprint,
        scored: tools().map(|tool| tool.scored).sum(),
        failed: tools().map(|tool| tool.failed).sum(),
        ended: tools().map(|tool| tool.ended).sum(),
        violation: simulator.violation,
        log: simulator.log.unwrap_or_default(),
    }
}

impl<'a> Simulator<'a> {
    fn new(schedule: &'a Schedule, log: bool) -> Self {
        let clients = schedule.tools.len() + schedule.servers.len();
        Self {
            base: Instant::now(),
            now: 0,
            agenda: BTreeMap::new(),
            serial: 0,
            events: 0,
            network: Network::new(
                schedule.seed,
                schedule.servers.iter().any(|server| server.plain),
            ),
            clients: (0..clients).map(|_| Client::default()).collect(),
            tools: (0..schedule.tools.len())
                .map(|index| Tool::new(schedule, index))
                .collect(),
            servers: schedule.servers.iter().map(|_| None).collect(),
            active: Vec::new(),
            idle: BTreeMap::new(),
            violation: None,
            fingerprint: 0,
            end: 0,
            log: log.then(Vec::new),
            schedule,
        }
    }

    fn prepare(&mut self) {
        let joins = self.schedule.tools.iter().map(|tool| tool.joins);
        let joins = joins.chain(self.schedule.servers.iter().map(|server| server.joins));
        for (peer, at) in joins.enumerate().collect::<Vec<_>>() {
            self.plan(at, Event::Start { who: peer });
        }
        for (number, disturbance) in self.schedule.disturbances.iter().enumerate() {
            self.plan(disturbance.at, Event::Begin(number));
            self.plan(disturbance.end(), Event::End(number));
            self.plan(disturbance.at / 2, Event::Save);
        }
        self.plan(LOOK, Event::Look);
    }

    pub(crate) fn plan(&mut self, at: Time, event: Event) {
        self.serial += 1;
        self.agenda.insert((at.max(self.now), self.serial), event);
    }

    pub(crate) fn instant(&self) -> Instant {
        self.base + Duration::from_micros(self.now)
    }

    /// The first microsecond that is not before an instant.
    pub(crate) fn time(&self, instant: Instant) -> Time {
        let nanoseconds = instant.saturating_duration_since(self.base).as_nanos();
        Time::try_from(nanoseconds.div_ceil(1000)).unwrap_or(Time::MAX)
    }

    pub(crate) fn note(&mut self, text: impl FnOnce() -> String) {
        if let Some(log) = &mut self.log {
            if log.len() >= LOG {
                log.remove(0);
            }
            log.push(format!(
                "{:>6}.{:06}  {}",
                self.now / SECOND,
                self.now % SECOND,
                text()
            ));
        }
    }

    pub(crate) fn violate(&mut self, text: String) {
        self.note(|| format!("VIOLATION: {text}"));
        self.violation.get_or_insert(text);
    }

    /// When all work must be done.
    fn deadline(&self) -> Time {
        let slowest = self
            .schedule
            .servers
            .iter()
            .map(|server| server.pace)
            .max()
            .unwrap_or(0);
        let mut evaluations = 0;
        let mut failures = 0;
        for tool in &self.schedule.tools {
            for work in &tool.works {
                let bad = (work.failing.len() + work.deadly.len()) * work.episodes;
                evaluations += work.candidates * work.episodes;
                // A server that fails has a growing pause.
                failures +=
                    bad as u64 * u64::from(tool.attempts) * (tool.step_timeout + LONGEST_BENCH);
            }
        }
        self.schedule.calm() + RECOVERY + failures + 20 * slowest * evaluations as u64
    }

    fn run(&mut self) {
        let deadline = self.deadline();
        let mut quiet = None;
        while let Some(((at, serial), event)) = self.agenda.pop_first() {
            self.now = at;
            self.events += 1;
            if self.events > MOST_EVENTS {
                self.violate(format!("more than {MOST_EVENTS} events"));
            } else if quiet.is_none() && at > deadline {
                self.late();
            }
            if self.violation.is_some() {
                return;
            }
            let kind = match &event {
                Event::Arrive {
                    connection,
                    up,
                    packet: Packet::Publish { payload, .. },
                } => mix(&[*connection as u64, u64::from(*up), payload.len() as u64]),
                _ => 0,
            };
            self.fingerprint = mix(&[self.fingerprint, at, serial, kind]);
            self.happen(event);
            let finished = || self.tools.iter().all(|tool| tool.stage == Stage::Finished);
            match quiet {
                None if finished() => {
                    self.end = self.now;
                    let patience = self
                        .schedule
                        .servers
                        .iter()
                        .map(|server| server.patience)
                        .max();
                    quiet = Some(
                        self.now.max(self.schedule.calm()) + patience.unwrap_or(0) + 70 * SECOND,
                    );
                }
                Some(until) if self.now >= until => return self.check_rest(),
                _ => {}
            }
        }
    }

    fn happen(&mut self, event: Event) {
        match event {
            Event::Arrive {
                connection,
                up,
                packet,
            } => self.arrive(connection, up, packet),
            Event::Timer {
                who: peer,
                incarnation,
            } => self.timer(peer, incarnation),
            Event::Done { .. } | Event::Submit { .. } | Event::Connect { .. } => {
                self.client_event(event)
            }
            Event::Start { who: peer } => self.start(peer),
            Event::Silence { connection, cause } => self.silence(connection, cause),
            Event::GiveUp { connection, cause } => self.give_up(connection, cause),
            Event::Begin(number) => self.begin(number),
            Event::End(number) => self.finish(number),
            Event::Save => self.network.snapshot = self.network.retained.clone(),
            Event::Look => self.look(),
        }
    }

    /// Whether a client can be reached and reacts.
    pub(crate) fn is_well(&self, peer: usize) -> bool {
        let client = &self.clients[peer];
        client.alive && client.ready && client.frozen.is_empty() && client.cut_off.is_empty()
    }
}
