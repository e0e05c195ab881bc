//! Fault injection: what disturbances do when they begin and when they end.

use crate::client::THINKS;
use crate::network::Packet;
use crate::random::mix;
use crate::schedule::{
    BROKER_PATIENCE, CLIENT_PATIENCE, Disturbance, MILLI, Memory, Schedule, What, Who,
};
use crate::simulator::{Event, Simulator};
use crate::tool::Stage;

impl Schedule {
    /// Index of a party among all of them: tools, then servers.
    pub(crate) fn index(&self, party: Who) -> usize {
        match party {
            Who::Tool(tool) => tool,
            Who::Server(server) => self.tools.len() + server,
        }
    }

    /// Name of the party of an index.
    pub(crate) fn name(&self, peer: usize) -> String {
        let party = match peer.checked_sub(self.tools.len()) {
            Some(server) => Who::Server(server),
            None => Who::Tool(peer),
        };
        party.to_string()
    }
}

impl Simulator<'_> {
    pub(crate) fn begin(&mut self, number: usize) {
        let disturbance = self.schedule.disturbances[number].clone();
        self.note(|| format!("BEGINS: {disturbance}"));
        let event = disturbance.what;
        let peer = disturbance.who().map(|party| self.schedule.index(party));
        self.active.push((number as u64, disturbance));
        match (event, peer) {
            (What::Cut(_), Some(peer)) => {
                if let Some(connection) = self.clients[peer].connection {
                    self.broker_closes(connection, false);
                    if self.clients[peer].frozen.is_empty() {
                        self.lose_connection(peer);
                    } else {
                        self.send(connection, false, &Packet::Closed, 0);
                    }
                }
            }
            (What::Partition(_), Some(peer)) => {
                self.clients[peer].cut_off.push(number);
                if let Some(connection) = self.clients[peer].connection {
                    self.plan(
                        self.now + BROKER_PATIENCE,
                        Event::Silence {
                            connection,
                            cause: number,
                        },
                    );
                    self.plan(
                        self.now + CLIENT_PATIENCE,
                        Event::GiveUp {
                            connection,
                            cause: number,
                        },
                    );
                }
            }
            (What::Freeze(_), Some(peer)) if self.clients[peer].alive => {
                self.clients[peer].frozen.push(number);
                if let Some(connection) = self.clients[peer].connection {
                    let (at, cause) = (self.now + BROKER_PATIENCE, number);
                    self.plan(at, Event::Silence { connection, cause });
                }
            }
            (What::Crash { power, .. }, Some(peer)) if self.clients[peer].alive => {
                self.kill(peer, power.then_some(number))
            }
            (What::Restart(_), Some(peer)) if self.clients[peer].alive => self.kill(peer, None),
            (What::Leave(server), Some(peer)) => self.leave(peer, server),
            (What::Break(server), _) => self.set_broken(server),
            (What::Interrupt(tool), Some(peer)) => self.interrupt(peer, tool),
            (What::Broker(memory), _) => self.stop_broker(memory),
            _ => {}
        }
    }

    pub(crate) fn finish(&mut self, number: usize) {
        let disturbance = self.schedule.disturbances[number].clone();
        if disturbance.lasts > 0 {
            self.note(|| format!("ENDS: {disturbance}"));
        }
        self.active.retain(|(active, _)| *active != number as u64);
        let Some(peer) = disturbance.who().map(|party| self.schedule.index(party)) else {
            let brokers = |event: &What| matches!(event, What::Broker(_));
            self.network.up = !self
                .active
                .iter()
                .any(|(_, disturbance)| brokers(&disturbance.what));
            return;
        };
        match disturbance.what {
            What::Partition(_) => {
                self.clients[peer].cut_off.retain(|cause| *cause != number);
                if self.clients[peer].cut_off.is_empty() {
                    self.heal(peer);
                }
            }
            What::Freeze(_) => {
                let was = self.clients[peer].frozen.contains(&number);
                self.clients[peer].frozen.retain(|cause| *cause != number);
                if was && self.clients[peer].frozen.is_empty() {
                    let late = mix(&[self.schedule.seed, number as u64]).is_multiple_of(4);
                    self.catch_up(peer, late);
                }
            }
            What::Crash { .. } | What::Leave(_) | What::Restart(_) => self.start(peer),
            What::Break(server) => self.set_broken(server),
            _ => {}
        }
    }

    /// Tells a server's process whether its installation is broken now.
    pub(crate) fn set_broken(&self, server: usize) {
        let breaks = |disturbance: &Disturbance| disturbance.what == What::Break(server);
        let broken = self
            .active
            .iter()
            .any(|(_, disturbance)| breaks(disturbance));
        if let Some(process) = &self.servers[server] {
            process.set_broken(broken);
        }
    }

    fn leave(&mut self, peer: usize, server: usize) {
        if !self.is_well(peer) {
            return;
        }
        let now = self.instant();
        let Some(process) = &mut self.servers[server] else {
            return;
        };
        let messages = process.leave(now);
        self.publish(peer, messages);
        if let Some(connection) = self.clients[peer].connection {
            self.send(connection, true, &Packet::Goodbye, 0);
        }
        self.kill(peer, None);
    }

    fn interrupt(&mut self, peer: usize, tool: usize) {
        let now = self.instant();
        let well = self.clients[peer].alive && self.clients[peer].frozen.is_empty();
        if !well || self.tools[tool].stage != Stage::Working {
            return;
        }
        if let Some(machine) = &mut self.tools[tool].machine {
            machine.cancel();
            self.tools[tool].stage = Stage::Thinking;
            let messages = self.tools[tool].act();
            self.publish(peer, messages);
            self.clients[peer].frozen.push(THINKS);
            let incarnation = self.clients[peer].incarnation;
            self.plan(
                self.time(now) + MILLI,
                Event::Submit {
                    who: peer,
                    incarnation,
                },
            );
        }
    }

    fn stop_broker(&mut self, memory: Memory) {
        self.network.up = false;
        match memory {
            Memory::Kept => {}
            Memory::Stale => self.network.retained = self.network.snapshot.clone(),
            Memory::Lost => self.network.retained.clear(),
        }
        for connection in 0..self.network.connections.len() {
            let link = &mut self.network.connections[connection];
            if std::mem::take(&mut link.broker_open) {
                // A broker that dies publishes no last wills; the system closes its connections.
                link.will = None;
                self.send(connection, false, &Packet::Closed, 0);
            }
        }
    }

    /// Handles a client of which the broker has heard nothing for long.
    pub(crate) fn silence(&mut self, connection: usize, cause: usize) {
        let link = &self.network.connections[connection];
        let client = &self.clients[link.who];
        let same = client.connection == Some(connection);
        let silent = !same || client.frozen.contains(&cause) || client.cut_off.contains(&cause);
        if silent && self.network.up {
            self.broker_closes(connection, true);
        }
    }

    /// A client has heard nothing of the broker for long.
    pub(crate) fn give_up(&mut self, connection: usize, cause: usize) {
        let peer = self.network.connections[connection].who;
        let client = &self.clients[peer];
        if client.connection == Some(connection)
            && client.cut_off.contains(&cause)
            && client.frozen.is_empty()
        {
            self.send(connection, true, &Packet::Closed, 0);
            self.lose_connection(peer);
        }
    }
}
