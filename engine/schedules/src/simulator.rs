//! Virtual time: what happens next, and whether it may.

use std::collections::BTreeMap;
use std::rc::Rc;
use std::time::{Duration, Instant};

use swarmwright_protocol::{Message, State, Topic, Topics};

use crate::client::Client;
use crate::network::{Network, Packet};
use crate::random::mix;
use crate::schedule;
use crate::schedule::{Disturbance, MILLI, SECOND, Schedule, Time, What};
use crate::server::Server;
use crate::tool::{Stage, Tool};

/// How long a server may be idle and known while work waits: a round of discovery, and some time for messages.
pub const IDLE: Time = 3 * SECOND;
/// How much longer where a server may be taken for two.
const DOUBT: Time = 6 * SECOND;
/// How long a tool that has no work for a server keeps it.
const HELD: Time = 5 * SECOND;
/// How often it is looked whether a server idles or a tool remembers too much.
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
    /// A tool has thought.
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
    /// The disturbances under way, by number.
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
        for (who, at) in joins.enumerate().collect::<Vec<_>>() {
            self.plan(at, Event::Start { who });
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
            Event::Timer { who, incarnation } => self.timer(who, incarnation),
            Event::Done { .. } | Event::Submit { .. } | Event::Connect { .. } => {
                self.client_event(event)
            }
            Event::Start { who } => self.start(who),
            Event::Silence { connection, cause } => self.silence(connection, cause),
            Event::GiveUp { connection, cause } => self.give_up(connection, cause),
            Event::Begin(number) => self.begin(number),
            Event::End(number) => self.finish(number),
            Event::Save => self.network.snapshot = self.network.retained.clone(),
            Event::Look => self.look(),
        }
    }

    fn late(&mut self) {
        let tools: Vec<String> = self
            .tools
            .iter()
            .enumerate()
            .filter(|(_, tool)| tool.stage != Stage::Finished)
            .map(|(index, tool)| {
                let machine = tool.machine.as_ref();
                let state = machine.map_or_else(String::new, |machine| {
                    format!(
                        "{:?}, {} of {} done, {}, {}",
                        machine.holdings(),
                        machine.done(),
                        machine.total(),
                        machine.waiting_for(self.instant()),
                        machine.describe()
                    )
                });
                format!(
                    "tool {index} ({:?}): {state}; last warnings {:?}",
                    tool.stage, tool.warnings
                )
            })
            .collect();
        self.violate(format!("work waits for ever: {}", tools.join("; ")));
    }

    /// Whether a client can be reached and reacts.
    pub(crate) fn is_well(&self, who: usize) -> bool {
        let client = &self.clients[who];
        client.alive && client.ready && client.frozen.is_empty() && client.cut_off.is_empty()
    }

    fn look(&mut self) {
        self.plan(self.now + LOOK, Event::Look);
        let harsh = self
            .active
            .iter()
            .any(|(_, disturbance)| disturbance.is_harsh() || disturbance.delays());
        for tool in 0..self.tools.len() {
            if let Err(text) = self.tools[tool].check_memory(self.servers.len()) {
                self.violate(format!("tool {tool}: {text}"));
            }
            let queued = self.tools[tool]
                .machine
                .as_ref()
                .map_or(0, |machine| machine.holdings().queued);
            for server in 0..self.servers.len() {
                let well = self.is_well(tool) && self.is_well(self.tools.len() + server);
                let alone = !self.schedule.has_twin(server);
                let asked = queued > 0 && !harsh && well && alone && self.could_use(tool, server);
                for (free, bound) in [(true, IDLE), (false, IDLE + HELD)] {
                    let idle = asked && self.is_vacant(server, free);
                    self.watch((tool, server, free), idle, bound + self.allowance(server));
                }
            }
        }
    }

    /// Checks that no server idles for longer than a bound.
    fn watch(&mut self, key: (usize, usize, bool), idle: bool, bound: Time) {
        if !idle {
            self.idle.remove(&key);
            return;
        }
        let (tool, server, free) = key;
        let since = *self.idle.entry(key).or_insert(self.now);
        if self.now - since > bound {
            let words = self.tools[tool]
                .machine
                .as_ref()
                .map(|machine| machine.describe());
            self.violate(format!(
                "server {} has {} for {} ms while evaluations of tool {tool} waited: {}",
                server + 1,
                if free {
                    "idled"
                } else {
                    "been held for nothing"
                },
                (self.now - since) / MILLI,
                words.unwrap_or_default()
            ));
        }
    }

    /// How much longer a server may idle: where a start of it whose end was not seen makes two of it for some rounds of
    /// discovery, and as long as it seems to take for one evaluation, where the others may be done before.
    fn allowance(&self, server: usize) -> Time {
        let begun = |disturbance: &&Disturbance| disturbance.at <= self.now;
        let extra = self.schedule.disturbances.iter().filter(begun);
        let extra = extra.map(|disturbance| match disturbance.what {
            What::Crash {
                server: crashed,
                power,
            } if power && crashed == server => DOUBT,
            What::Freeze(_) | What::Partition(_) => disturbance.lasts,
            What::Delay { by, .. } => 40 * by,
            // That it is free may be what was lost.
            What::Lose { .. } => self.schedule.servers[server].patience,
            _ => 0,
        });
        extra.sum::<Time>() + 40 * self.schedule.servers[server].pace
    }

    /// Whether a tool has work that it could give to a server.
    fn could_use(&self, tool: usize, server: usize) -> bool {
        let schedule::Server { plain, twin, .. } = self.schedule.servers[server];
        if twin.is_some_and(|twin| twin.foreign) {
            return false;
        }
        let mode = self.schedule.tools[tool].mode.as_str();
        let machine = self.tools[tool].machine.as_ref();
        (!plain || matches!(mode, "auto" | "stepwise"))
            && machine.is_some_and(|machine| machine.is_idle(self.schedule.id(server)))
    }

    /// Whether a server has nothing to do. `free`: because no tool has it, else because a tool has it that lives and has no
    /// work on it.
    fn is_vacant(&self, server: usize, free: bool) -> bool {
        let Some(process) = &self.servers[server] else {
            return false;
        };
        if free {
            return process.is_free();
        }
        let holder = process.machine.holder();
        let lets_down = |tool: &Tool| {
            let machine = tool.machine.as_ref();
            tool.stage != Stage::Finished
                && holder.as_ref() == Some(&tool.name)
                && machine.is_some_and(|machine| machine.has_nothing_on(process.id))
        };
        process.job.is_none() && self.tools.iter().any(lets_down)
    }

    /// Whether a server is gone since another one has its id.
    fn has_given_way(&self, server: usize) -> bool {
        let id = self.schedule.id(server);
        let others = (0..self.servers.len()).filter(|other| *other != server);
        let mut others = others.filter(|other| self.schedule.id(*other) == id);
        others.any(|other| self.is_well(self.tools.len() + other))
    }

    /// When all is over: all servers are free, and say so.
    fn check_rest(&mut self) {
        for index in 0..self.servers.len() {
            let who = self.tools.len() + index;
            if !self.clients[who].alive && self.has_given_way(index) {
                continue;
            }
            let Some(server) = self.servers[index].as_ref().filter(|_| self.is_well(who)) else {
                let client = &self.clients[who];
                return self.violate(format!(
                    "server {} is not there at the end: {client:?}",
                    index + 1
                ));
            };
            if !server.is_free() {
                return self.violate(format!("server {} is not free at the end", index + 1));
            }
            if server.is_plain() {
                continue;
            }
            let topic: Rc<str> = Topics::default().presence(server.id).into();
            let retained = self.network.retained.get(&topic);
            let presence = retained.map(|payload| Message::decode(Topic::Presence, payload));
            let right = match &presence {
                Some(Ok(Message::Presence(presence))) => {
                    let announced = presence.capabilities.swarmwright.as_ref();
                    let instance = announced.and_then(|announced| announced.instance.as_deref());
                    presence.state == State::Ready && instance == Some(server.instance())
                }
                _ => false,
            };
            if !right {
                return self.violate(format!(
                    "what is retained of server {} at the end is {presence:?}",
                    index + 1
                ));
            }
        }
        for tool in 0..self.tools.len() {
            if let Err(text) = self.tools[tool].check_memory(self.servers.len()) {
                self.violate(format!("tool {tool} at the end: {text}"));
            }
        }
    }
}
