//! One tool and very many servers in virtual time: what that costs the tool, the servers and the network.
//!
//! Scheduler and servers are those of the [schedules](crate::check), the network is simpler: nothing is lost, and messages
//! find their subscribers by name, so that 10,000 servers can be simulated. What a server computes is real, but takes the
//! time that it is given. The tool takes no virtual time; its real processor time is measured beside it.

use std::collections::BTreeMap;
use std::rc::Rc;
use std::time::{Duration, Instant};

use serde::Serialize;
use swarmwright_pool::{Action, Config, Demand, Faults, Mode, Scheduler, Timeouts, WorkError};
use swarmwright_protocol::{Requirements, Topic, Topics};

use crate::random::mix;
use crate::schedule::{self, Kind, MILLI, SECOND, Time};
use crate::server::{Outgoing, Server};
use crate::trail;

/// Within this time all servers start.
const START: Time = 5 * SECOND;
/// From SIGTERM to the end of a server, at most.
const GRACE: Time = 3 * SECOND;
/// From the end of a server to its next start.
const DOWN: Time = 10 * SECOND;
/// How many times as long as the mean the slowest server takes; see [`pace`].
const SLOWEST: u64 = 2;
/// Steps of an episode, on average; see [`Server::time`].
const STEPS: u64 = 3;
/// More events are an endless loop.
const MOST_EVENTS: u64 = 400_000_000;

/// What is simulated.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Scale {
    /// Of the latencies, speeds and preemptions.
    pub seed: u64,
    /// Number of servers.
    pub servers: usize,
    /// How long an episode takes, in microseconds: the geometric mean of servers whose speeds are 1:4.
    pub episode: Time,
    /// Mean time from a start of a server to its preemption, in microseconds; none for none.
    pub preempted_after: Option<Time>,
    /// Candidates of a generation for each server.
    pub share: usize,
    /// Generations after the first one, which is not measured: servers start in it.
    pub generations: usize,
}

/// Messages by what they are about.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub struct Messages {
    /// Discovery, heard by all servers.
    pub discovery: u64,
    /// Parameters, control and actuators, heard by all servers.
    pub control: u64,
    /// On a server's own topic.
    pub own: u64,
}

/// What came out; rates and shares are those of the generations that were measured.
#[derive(Debug, Clone, Serialize)]
pub struct Figures {
    /// Virtual seconds.
    pub seconds: f64,
    /// Evaluations that counted.
    pub evaluations: usize,
    /// Servers that were preempted.
    pub preemptions: u64,
    /// Share of the time of all servers that they computed what counted.
    pub utilisation: f64,
    /// Share of the computing time that was lost.
    pub lost: f64,
    /// Messages that the tool published and received, for each evaluation.
    pub messages_per_evaluation: f64,
    /// Messages that a server received in a second, by what they are about.
    pub heard_per_second: [f64; 3],
    /// Processor time of the tool for each evaluation, microseconds.
    pub tool_us_per_evaluation: f64,
    /// Processor time of the tool in a virtual second: more than 1 cannot be.
    pub tool_load: f64,
    /// Most bytes that the tool held at once; 0 where nothing counts them.
    pub tool_bytes: isize,
    /// Rounds of discovery in a second.
    pub discoveries_per_second: f64,
    /// Incidents that the tool counted.
    pub counts: BTreeMap<String, u64>,
}

enum Event {
    ToTool(Rc<str>, Rc<[u8]>),
    ToServer(usize, u64, Rc<str>, Rc<[u8]>),
    ToolTimer,
    ServerTimer(usize, u64),
    Done(usize, u64, u64, Time),
    Start(usize),
    Preempt(usize, u64),
    Leave(usize, u64),
}

#[derive(Default)]
struct Seat {
    server: Option<Server>,
    life: u64,
    armed: Option<Time>,
    /// Since when it computes, and for how many microseconds.
    computes: Option<(Time, Time)>,
    /// It is to leave when it has finished what it computes.
    leaves: bool,
    /// When the last message to it and from it arrives.
    down: Time,
    up: Time,
    sent: u64,
}

#[derive(Clone, Copy, Default)]
struct Sums {
    at: Time,
    useful: Time,
    lost: Time,
    evaluations: usize,
    messages: u64,
    heard: Messages,
    rounds: u64,
    cpu: Duration,
    preemptions: u64,
}

struct Simulation<'a> {
    scale: &'a Scale,
    held: &'a dyn Fn() -> isize,
    base: Instant,
    now: Time,
    agenda: BTreeMap<(Time, u64), Event>,
    serial: u64,
    tool: Scheduler,
    /// When the tool was to have its next tick, as it said when it was asked.
    tool_tick: Time,
    /// When it is to be asked again.
    tool_query: Time,
    tool_armed: Option<Time>,
    seats: Vec<Seat>,
    sums: Sums,
    bytes: isize,
    most_bytes: isize,
    topics: Topics,
}

/// Simulates. `held`: the bytes that this thread holds, of an allocator that counts them.
///
/// # Errors
/// None for sensible numbers.
pub fn simulate(scale: &Scale, held: &dyn Fn() -> isize) -> Result<Figures, WorkError> {
    let base = Instant::now();
    let before = held();
    let tool = Scheduler::new(config(scale), base);
    let mut simulation = Simulation {
        scale,
        held,
        base,
        now: 0,
        agenda: BTreeMap::new(),
        serial: 0,
        tool,
        tool_tick: 0,
        tool_query: 0,
        tool_armed: None,
        seats: (0..scale.servers).map(|_| Seat::default()).collect(),
        sums: Sums::default(),
        bytes: held() - before,
        most_bytes: 0,
        topics: Topics::default(),
    };
    simulation.run()
}

/// As users set it: the slowest server is given twice the time that it needs for an episode.
fn config(scale: &Scale) -> Config {
    let timeouts = Timeouts::default();
    let slowest = Duration::from_micros(SLOWEST * scale.episode);
    Config {
        demand: Demand {
            simulation: trail::TITLE.to_owned(),
            requirements: Requirements {
                dimensions: 2.0,
                max_agents: None,
            },
            sensors: Some(2),
            actuators: Some(1),
            mode: Mode::Auto,
            kind: None,
            modules: Vec::new(),
            metrics: Vec::new(),
        },
        parameters: trail::parameters(),
        token: "tool".to_owned(),
        tool: "tool".to_owned(),
        topics: Topics::default(),
        visual: false,
        timeouts: Timeouts {
            step: timeouts.step.max(2 * slowest),
            ..timeouts
        },
        faults: Faults::default(),
        largest: usize::MAX,
        probation: Duration::from_millis(30),
        first_instance: 1,
    }
}

impl Simulation<'_> {
    fn run(&mut self) -> Result<Figures, WorkError> {
        for index in 0..self.seats.len() {
            let at = self.draw(&[1, index as u64]) % START;
            self.plan(at, Event::Start(index));
        }
        self.with_tool(|tool, now| tool.connected(now));
        let mut from = Sums::default();
        for generation in 0..=self.scale.generations {
            if generation == 1 {
                from = self.note();
            }
            self.generation(generation)?;
        }
        let to = self.note();
        Ok(self.figures(&from, &to))
    }

    fn note(&mut self) -> Sums {
        // What is being computed counts up to now.
        let under_way = self.seats.iter().filter_map(|seat| seat.computes);
        let under_way: Time = under_way.map(|(since, _)| self.now - since).sum();
        Sums {
            at: self.now,
            useful: self.sums.useful + under_way,
            ..self.sums
        }
    }

    #[expect(clippy::cast_precision_loss, reason = "figures for people")]
    fn figures(&self, from: &Sums, to: &Sums) -> Figures {
        let time = (to.at - from.at) as f64;
        let seconds = time / SECOND as f64;
        let servers = self.scale.servers as f64;
        let useful = (to.useful - from.useful) as f64;
        let lost = (to.lost - from.lost) as f64;
        let evaluations = to.evaluations - from.evaluations;
        let cpu = (to.cpu - from.cpu).as_secs_f64();
        let per = |more: u64, before: u64| (more - before) as f64 / seconds / servers;
        let counts = serde_json::to_value(self.tool.counts()).unwrap_or_default();
        let counts: BTreeMap<String, u64> = serde_json::from_value(counts).unwrap_or_default();
        Figures {
            seconds,
            evaluations,
            preemptions: to.preemptions - from.preemptions,
            utilisation: useful / (servers * time),
            lost: lost / (lost + useful).max(1.0),
            messages_per_evaluation: (to.messages - from.messages) as f64 / evaluations as f64,
            heard_per_second: [
                per(to.heard.discovery, from.heard.discovery),
                per(to.heard.control, from.heard.control),
                per(to.heard.own, from.heard.own),
            ],
            tool_us_per_evaluation: cpu * 1e6 / evaluations as f64,
            tool_load: cpu / seconds,
            tool_bytes: self.most_bytes,
            discoveries_per_second: (to.rounds - from.rounds) as f64 / seconds,
            counts: counts.into_iter().filter(|(_, count)| *count > 0).collect(),
        }
    }

    fn generation(&mut self, generation: usize) -> Result<(), WorkError> {
        let plan = schedule::Work {
            kind: Kind::Layered,
            candidates: self.scale.share * self.scale.servers,
            episodes: 1,
            window: None,
            failing: Vec::new(),
            deadly: Vec::new(),
            pause: 0,
        };
        let candidates: Vec<usize> = (0..plan.candidates).collect();
        let work = trail::work(&plan, generation as u64, &candidates)?;
        self.with_tool(|tool, now| tool.submit(work, now));
        let mut events = 0;
        while !self.tool.finished() && events < MOST_EVENTS {
            let Some(((at, _), event)) = self.agenda.pop_first() else {
                break;
            };
            self.now = at;
            events += 1;
            self.happen(event);
        }
        self.sums.evaluations += plan.candidates;
        self.with_tool(|tool, _| {
            drop(tool.take_all());
            drop(tool.take_journal());
        });
        Ok(())
    }

    fn happen(&mut self, event: Event) {
        let now = self.instant();
        match event {
            Event::ToTool(topic, payload) => {
                self.sums.messages += 1;
                self.with_tool(|tool, now| tool.receive(&topic, &payload, false, now));
            }
            Event::ToolTimer => {
                if self.tool_armed == Some(self.now) {
                    self.tool_armed = None;
                    if self.tool_tick <= self.now {
                        self.tool_query = self.now;
                        self.with_tool(Scheduler::tick);
                    } else {
                        self.with_tool(|_, _| {});
                    }
                }
            }
            Event::ToServer(index, life, topic, payload) => {
                let Some(server) = self.server(index, life) else {
                    return;
                };
                server.receive(&topic, &payload, false, now);
                self.after(index);
            }
            Event::ServerTimer(index, life) => {
                let at = self.now;
                if self.seats[index].armed != Some(at) {
                    return;
                }
                self.seats[index].armed = None;
                if let Some(server) = self.server(index, life) {
                    server.machine.tick(now, String::new);
                    self.after(index);
                }
            }
            Event::Done(index, life, job, took) => {
                let Some(server) = self.server(index, life).filter(|server| server.jobs == job)
                else {
                    return;
                };
                server.finish(took, now);
                self.seats[index].computes = None;
                self.sums.useful += took;
                self.after(index);
                if self.seats[index].leaves {
                    self.leave(index);
                }
            }
            Event::Start(index) => self.start(index),
            Event::Preempt(index, life) => {
                if self.server(index, life).is_none() {
                    return;
                }
                self.sums.preemptions += 1;
                if self.seats[index].computes.is_none() {
                    return self.leave(index);
                }
                self.seats[index].leaves = true;
                self.plan(self.now + GRACE, Event::Leave(index, life));
            }
            Event::Leave(index, life) => {
                if self.server(index, life).is_some() {
                    self.leave(index);
                }
            }
        }
    }

    fn start(&mut self, index: usize) {
        let id = index as u64 + 1;
        let seat = &mut self.seats[index];
        seat.life += 1;
        seat.armed = None;
        let life = seat.life;
        let plan = schedule::Server {
            joins: 0,
            pace: pace(self.scale, index),
            patience: 60 * SECOND,
            plain: false,
            twin: None,
        };
        let mut server = Server::new(&plan, index, id, life);
        server.machine.connected(String::new(), self.instant());
        self.seats[index].server = Some(server);
        if let Some(mean) = self.scale.preempted_after {
            let share = self.draw(&[2, index as u64, life]) >> 11;
            #[expect(
                clippy::cast_precision_loss,
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a share of 53 bits, a positive time"
            )]
            let lasts = (-(1.0 - share as f64 / (1u64 << 53) as f64).ln() * mean as f64) as Time;
            self.plan(self.now + lasts, Event::Preempt(index, life));
        }
        self.after(index);
    }

    fn leave(&mut self, index: usize) {
        let now = self.instant();
        let seat = &mut self.seats[index];
        seat.leaves = false;
        if let Some((since, _)) = seat.computes.take() {
            self.sums.lost += self.now - since;
        }
        let messages = seat
            .server
            .take()
            .map_or_else(Vec::new, |mut server| server.leave(now));
        self.sent_by_server(index, messages);
        self.plan(self.now + DOWN, Event::Start(index));
    }

    /// Does what a server wants done, and sets its timer.
    fn after(&mut self, index: usize) {
        let seat = &mut self.seats[index];
        let life = seat.life;
        let Some(server) = &mut seat.server else {
            return;
        };
        let (messages, begins) = server.act(1);
        let (took, job, next) = (server.time(1), server.jobs, server.machine.next_tick());
        if begins {
            seat.computes = Some((self.now, took));
            self.plan(self.now + took, Event::Done(index, life, job, took));
        }
        self.sent_by_server(index, messages);
        if let Some(at) = next.map(|at| self.time(at))
            && self.seats[index].armed != Some(at)
        {
            self.seats[index].armed = Some(at);
            self.plan(at, Event::ServerTimer(index, life));
        }
    }

    fn sent_by_server(&mut self, index: usize, messages: Vec<Outgoing>) {
        for message in messages {
            let at = self.now + message.after + self.latency(index);
            let at = at.max(self.seats[index].up + 1);
            self.seats[index].up = at;
            self.plan(at, Event::ToTool(message.topic, message.payload));
        }
    }

    fn deliver_to_server(&mut self, index: usize, topic: &Rc<str>, payload: &Rc<[u8]>) {
        let at = self.now + self.latency(index);
        let seat = &mut self.seats[index];
        if seat.server.is_none() {
            return;
        }
        let at = at.max(seat.down + 1);
        seat.down = at;
        let life = seat.life;
        let event = Event::ToServer(index, life, Rc::clone(topic), Rc::clone(payload));
        self.plan(at, event);
    }

    /// Calls the tool, measures what it takes, does what it wants done, and sets its timer.
    fn with_tool(&mut self, call: impl FnOnce(&mut Scheduler, Instant)) {
        let now = self.instant();
        let (before, began) = ((self.held)(), Instant::now());
        call(&mut self.tool, now);
        let actions: Vec<Action> = self.tool.actions().collect();
        // As seldom as the pool's shell asks.
        let next_tick = (self.tool_query <= self.now).then(|| self.tool.next_tick());
        self.sums.cpu += began.elapsed();
        let leaving = actions.capacity() * size_of::<Action>()
            + actions.iter().map(payload_bytes).sum::<usize>();
        self.bytes += (self.held)() - before - isize::try_from(leaving).unwrap_or(0);
        self.most_bytes = self.most_bytes.max(self.bytes);
        for action in actions {
            self.act(action);
        }
        let at = if let Some(next) = next_tick {
            self.tool_query = self.time(now + self.tool.tick_query_interval());
            self.tool_tick = self.time(next);
            self.tool_tick
        } else {
            self.tool_tick.min(self.tool_query)
        };
        if self.tool_armed != Some(at) {
            self.tool_armed = Some(at);
            self.plan(at, Event::ToolTimer);
        }
    }

    fn act(&mut self, action: Action) {
        match action {
            Action::Publish(topic, payload) => {
                self.sums.messages += 1;
                let all = self.seats.iter().filter(|seat| seat.server.is_some());
                let all = all.count() as u64;
                if topic == Topic::Discovery {
                    self.sums.rounds += 1;
                    self.sums.heard.discovery += all;
                } else {
                    self.sums.heard.control += all;
                }
                let (name, payload) = (self.topics.name(topic).into(), Rc::from(payload));
                for index in 0..self.seats.len() {
                    self.deliver_to_server(index, &name, &payload);
                }
            }
            Action::Control { server, payload }
            | Action::Request {
                server, payload, ..
            } => {
                self.sums.messages += 1;
                self.sums.heard.own += 1;
                let name = self.topics.to_server(server).into();
                let index = usize::try_from(server).unwrap_or(0);
                if let Some(index) = index.checked_sub(1).filter(|at| *at < self.seats.len()) {
                    self.deliver_to_server(index, &name, &Rc::from(payload));
                }
            }
            Action::Warn(_)
            | Action::Unaudited(_)
            | Action::Failed { .. }
            | Action::Overdue(_)
            | Action::AskBroker => {}
        }
    }

    fn server(&mut self, index: usize, life: u64) -> Option<&mut Server> {
        let seat = &mut self.seats[index];
        seat.server.as_mut().filter(|_| seat.life == life)
    }

    /// 0.1 to 1.1 ms.
    fn latency(&mut self, index: usize) -> Time {
        self.seats[index].sent += 1;
        let sent = self.seats[index].sent;
        100 + self.draw(&[3, index as u64, sent]) % MILLI
    }

    fn draw(&self, address: &[u64]) -> u64 {
        address
            .iter()
            .fold(mix(&[self.scale.seed]), |state, part| mix(&[state, *part]))
    }

    fn plan(&mut self, at: Time, event: Event) {
        self.serial += 1;
        self.agenda.insert((at.max(self.now), self.serial), event);
    }

    fn instant(&self) -> Instant {
        self.base + Duration::from_micros(self.now)
    }

    /// The first microsecond that is not before an instant.
    fn time(&self, instant: Instant) -> Time {
        let nanoseconds = instant.saturating_duration_since(self.base).as_nanos();
        let at = Time::try_from(nanoseconds.div_ceil(1000)).unwrap_or(Time::MAX);
        at.max(self.now)
    }
}

fn payload_bytes(action: &Action) -> usize {
    match action {
        Action::Publish(_, payload)
        | Action::Control { payload, .. }
        | Action::Request { payload, .. } => payload.capacity(),
        Action::Warn(text) | Action::Unaudited(text) | Action::Failed { text, .. } => {
            text.capacity()
        }
        Action::Overdue(_) | Action::AskBroker => 0,
    }
}

/// Time for a step: speeds are spread from half to twice the mean.
fn pace(scale: &Scale, index: usize) -> Time {
    let share = mix(&[scale.seed, 4, index as u64]) % 1025;
    #[expect(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "small positive numbers"
    )]
    let time = (scale.episode as f64 / STEPS as f64 * (share as f64 / 512.0 - 1.0).exp2()) as Time;
    time.max(1)
}
