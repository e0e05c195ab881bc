//! A process and its connection.

mod broker;
mod follow_up;

use crate::network::Packet;
use crate::random::mix;
use crate::schedule::{BROKER_PATIENCE, MILLI, SECOND, Time};
use crate::server::Server;
use crate::simulator::{Event, Simulator};
use crate::tool::Stage;

/// Pause before the first attempt to reconnect; it doubles with each attempt.
const FIRST_PAUSE: Time = 100 * MILLI;
const LONGEST_PAUSE: Time = 10 * SECOND;
/// How long it takes until a server that its simulation has brought down is started again.
const REVIVAL: Time = SECOND;
/// Why a tool does not listen while it thinks: stands among the numbers of disturbances.
pub(crate) const THINKS: usize = usize::MAX;

/// A process, living or dead, and its end of a connection.
#[derive(Debug, Clone, Default)]
pub(crate) struct Client {
    pub alive: bool,
    /// Which start it is.
    pub incarnation: u64,
    pub connection: Option<usize>,
    /// Whether the broker has accepted it.
    pub ready: bool,
    /// Whether it was ever accepted since it started.
    begun: bool,
    /// It does nothing because of these.
    pub frozen: Vec<usize>,
    /// What it has yet to hear of.
    backlog: Vec<Event>,
    /// Nothing goes through because of these.
    pub cut_off: Vec<usize>,
    /// What is on its way meanwhile.
    held: Vec<Event>,
    /// When its timer is set.
    armed: Option<Time>,
    pause: Time,
    tries: u64,
}

impl Simulator<'_> {
    fn server_of(&self, peer: usize) -> Option<usize> {
        peer.checked_sub(self.tools.len())
    }

    /// A process starts, unless it runs or has done all it had to do.
    pub(crate) fn start(&mut self, peer: usize) {
        let finished = self
            .tools
            .get(peer)
            .is_some_and(|tool| tool.stage == Stage::Finished);
        let client = &mut self.clients[peer];
        if client.alive || finished {
            return;
        }
        *client = Client {
            alive: true,
            incarnation: client.incarnation + 1,
            cut_off: std::mem::take(&mut client.cut_off),
            held: std::mem::take(&mut client.held),
            pause: FIRST_PAUSE,
            ..Client::default()
        };
        let incarnation = client.incarnation;
        if let Some(server) = self.server_of(peer) {
            let plan = &self.schedule.servers[server];
            let id = self.schedule.id(server);
            self.servers[server] = Some(Server::new(plan, server, id, incarnation));
            self.set_broken(server);
        }
        self.note(|| format!("{} starts", self.schedule.name(peer)));
        self.plan(
            self.now,
            Event::Connect {
                who: peer,
                incarnation,
            },
        );
    }

    /// A process ends at once. `power_failure`: number of the disturbance that ends its computer, too, so that the broker
    /// does not see the connection end until it has waited for [`BROKER_PATIENCE`].
    pub(crate) fn kill(&mut self, peer: usize, power_failure: Option<usize>) {
        let client = &mut self.clients[peer];
        client.alive = false;
        client.ready = false;
        client.frozen.clear();
        client.backlog.clear();
        client.armed = None;
        let connection = client.connection.take();
        match self.server_of(peer) {
            Some(server) => self.servers[server] = None,
            None => {
                self.tools[peer].machine = None;
                if self.tools[peer].stage == Stage::Working {
                    self.tools[peer].stage = Stage::Thinking;
                }
            }
        }
        if let Some(connection) = connection {
            self.network.connections[connection].client_open = false;
            if let Some(cause) = power_failure {
                self.plan(
                    self.now + BROKER_PATIENCE,
                    Event::Silence { connection, cause },
                );
            } else {
                self.send(connection, true, &Packet::Closed, 0);
            }
        }
    }

    fn client_hears(&mut self, peer: usize, connection: usize, packet: Packet) {
        let now = self.instant();
        let server = self.server_of(peer);
        match packet {
            Packet::Publish {
                topic,
                payload,
                retained,
            } => {
                self.note(|| {
                    let text =
                        String::from_utf8_lossy(&payload[..payload.len().min(220)]).into_owned();
                    format!(
                        "{} hears on {topic}{}: {text:?}",
                        self.schedule.name(peer),
                        if retained { " (retained)" } else { "" }
                    )
                });
                if let Some(server) = server {
                    if let Some(process) = &mut self.servers[server] {
                        process.receive(&topic, &payload, retained, now);
                    }
                } else if let Some(machine) = &mut self.tools[peer].machine {
                    machine.receive(&topic, &payload, retained, now);
                }
            }
            Packet::Closed => {
                self.network.connections[connection].client_open = false;
                return self.lose_connection(peer);
            }
            Packet::Accepted => {
                let client = &mut self.clients[peer];
                client.ready = true;
                client.pause = FIRST_PAUSE;
                let (begun, incarnation) = (
                    std::mem::replace(&mut client.begun, true),
                    client.incarnation,
                );
                if let Some(server) = server {
                    if let Some(process) = &mut self.servers[server] {
                        process.machine.connected(String::new(), now);
                    }
                } else if let Some(machine) = &mut self.tools[peer].machine {
                    machine.connected(now);
                }
                if server.is_none() && !begun {
                    self.tools[peer].start(incarnation, now);
                    self.plan(
                        self.now,
                        Event::Submit {
                            who: peer,
                            incarnation,
                        },
                    );
                }
            }
            Packet::Goodbye => {}
        }
        self.after(peer);
    }

    /// A client notices that its connection is lost.
    pub(crate) fn lose_connection(&mut self, peer: usize) {
        let now = self.instant();
        let client = &mut self.clients[peer];
        let Some(connection) = client.connection.take() else {
            return;
        };
        client.ready = false;
        let (begun, incarnation) = (client.begun, client.incarnation);
        self.network.connections[connection].client_open = false;
        self.note(|| format!("{} loses its connection", self.schedule.name(peer)));
        if begun {
            if let Some(server) = self.server_of(peer) {
                if let Some(process) = &mut self.servers[server] {
                    process.machine.disconnected("the connection was lost", now);
                }
            } else if let Some(machine) = &mut self.tools[peer].machine {
                machine.disconnected(now);
            }
        }
        self.connect_later(peer, incarnation);
        self.after(peer);
    }

    fn connect_later(&mut self, peer: usize, incarnation: u64) {
        let client = &mut self.clients[peer];
        client.tries += 1;
        let jitter = mix(&[self.schedule.seed, peer as u64, incarnation, client.tries]) % 1000;
        let pause = client.pause * (500 + jitter) / 1000;
        client.pause = (client.pause * 2).min(LONGEST_PAUSE);
        self.plan(
            self.now + pause,
            Event::Connect {
                who: peer,
                incarnation,
            },
        );
    }

    /// An event inside a process.
    pub(crate) fn client_event(&mut self, event: Event) {
        let (Event::Done {
            who: peer,
            incarnation,
            ..
        }
        | Event::Submit {
            who: peer,
            incarnation,
        }
        | Event::Connect {
            who: peer,
            incarnation,
        }) = event
        else {
            return;
        };
        let client = &mut self.clients[peer];
        if !client.alive || client.incarnation != incarnation {
            return;
        }
        if let Event::Submit { .. } = event {
            // What comes meanwhile is heard afterwards.
            client.frozen.retain(|cause| *cause != THINKS);
        }
        if !client.frozen.is_empty() {
            return client.backlog.push(event);
        }
        match event {
            Event::Connect { .. } => self.connect(peer, incarnation),
            Event::Submit { .. } => {
                let now = self.instant();
                if let Err(error) = self.tools[peer].submit(now) {
                    self.violate(error.to_string());
                }
                self.after(peer);
                self.catch_up(peer, false);
            }
            Event::Done { job, took, .. } => {
                let now = self.instant();
                let server = self
                    .server_of(peer)
                    .and_then(|server| self.servers[server].as_mut());
                if let Some(server) = server.filter(|server| server.jobs == job) {
                    server.finish(took, now);
                    self.after(peer);
                }
            }
            _ => {}
        }
    }

    fn connect(&mut self, peer: usize, incarnation: u64) {
        if self.clients[peer].connection.is_some() {
            return;
        }
        if !self.network.up || !self.clients[peer].cut_off.is_empty() {
            return self.connect_later(peer, incarnation);
        }
        // The same client id: the broker gives up the connection before.
        let before: Vec<usize> = self
            .network
            .connections
            .iter()
            .enumerate()
            .filter(|(_, link)| {
                link.broker_open && link.who == peer && link.incarnation == incarnation
            })
            .map(|(number, _)| number)
            .collect();
        for connection in before {
            self.broker_closes(connection, false);
        }
        let (filters, will) = match self.server_of(peer) {
            Some(server) => match &self.servers[server] {
                Some(process) => (process.filters(), process.will()),
                None => return,
            },
            None => (self.tools[peer].filters(incarnation), None),
        };
        let connection = self.network.open(peer, incarnation, filters, will);
        self.clients[peer].connection = Some(connection);
        for packet in self.network.welcome(connection) {
            self.send(connection, false, &packet, 0);
        }
    }

    pub(crate) fn timer(&mut self, peer: usize, incarnation: u64) {
        let client = &mut self.clients[peer];
        if !client.alive || client.incarnation != incarnation || client.armed != Some(self.now) {
            return;
        }
        client.armed = None;
        if client.frozen.is_empty() {
            self.tick(peer);
            self.after(peer);
        }
    }

    fn tick(&mut self, peer: usize) {
        let now = self.instant();
        if let Some(server) = self.server_of(peer) {
            if let Some(process) = &mut self.servers[server] {
                process.machine.tick(now, String::new);
            }
        } else if let Some(machine) = &mut self.tools[peer].machine {
            machine.tick(now);
        }
    }

    /// A process goes on: it hears what came meanwhile. `late`: its timers are heard first.
    pub(crate) fn catch_up(&mut self, peer: usize, late: bool) {
        if late && self.clients[peer].alive {
            self.tick(peer);
            self.after(peer);
        }
        while self.clients[peer].frozen.is_empty() && !self.clients[peer].backlog.is_empty() {
            let event = self.clients[peer].backlog.remove(0);
            match event {
                Event::Arrive {
                    connection,
                    up,
                    packet,
                } => self.arrive(connection, up, packet),
                event => self.client_event(event),
            }
        }
        self.after(peer);
    }

    /// What was held back on the way arrives.
    pub(crate) fn heal(&mut self, peer: usize) {
        for event in std::mem::take(&mut self.clients[peer].held) {
            if let Event::Arrive {
                connection,
                up,
                packet,
            } = event
            {
                self.arrive(connection, up, packet);
            }
        }
    }
}
