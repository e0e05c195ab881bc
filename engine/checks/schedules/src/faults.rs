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
    pub(crate) fn index(&self, who: Who) -> usize {
        match who {
            Who::Tool(tool) => tool,
            Who::Server(server) => self.tools.len() + server,
        }
    }

    /// Name of the party of an index.
    pub(crate) fn name(&self, who: usize) -> String {
        let party = match who.checked_sub(self.tools.len()) {
            Some(server) => Who::Server(server),
            None => Who::Tool(who),
        };
        party.to_string()
    }
}

impl Simulator<'_> {
    pub(crate) fn begin(&mut self, number: usize) {
        let disturbance = self.schedule.disturbances[number].clone();
        self.note(|| format!("BEGINS: {disturbance}"));
        let what = disturbance.what;
        let who = disturbance.who().map(|who| self.schedule.index(who));
        self.active.push((number as u64, disturbance));
        match (what, who) {
            (What::Cut(_), Some(who)) => {
                if let Some(connection) = self.clients[who].connection {
                    self.broker_closes(connection, false);
                    if self.clients[who].frozen.is_empty() {
                        self.lose_connection(who);
                    } else {
                        self.send(connection, false, &Packet::Closed, 0);
                    }
                }
            }
            (What::Partition(_), Some(who)) => {
                self.clients[who].cut_off.push(number);
                if let Some(connection) = self.clients[who].connection {
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
            (What::Freeze(_), Some(who)) if self.clients[who].alive => {
                self.clients[who].frozen.push(number);
                if let Some(connection) = self.clients[who].connection {
                    let (at, cause) = (self.now + BROKER_PATIENCE, number);
                    self.plan(at, Event::Silence { connection, cause });
                }
            }
            (What::Crash { power, .. }, Some(who)) if self.clients[who].alive => {
                self.kill(who, power.then_some(number))
            }
            (What::Restart(_), Some(who)) if self.clients[who].alive => self.kill(who, None),
            (What::Leave(server), Some(who)) => self.leave(who, server),
            (What::Break(server), _) => self.set_broken(server),
            (What::Interrupt(tool), Some(who)) => self.interrupt(who, tool),
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
        let Some(who) = disturbance.who().map(|who| self.schedule.index(who)) else {
            let brokers = |what: &What| matches!(what, What::Broker(_));
            self.network.up = !self.active.iter().any(|(_, one)| brokers(&one.what));
            return;
        };
        match disturbance.what {
            What::Partition(_) => {
                self.clients[who].cut_off.retain(|cause| *cause != number);
                if self.clients[who].cut_off.is_empty() {
                    self.heal(who);
                }
            }
            What::Freeze(_) => {
                let was = self.clients[who].frozen.contains(&number);
                self.clients[who].frozen.retain(|cause| *cause != number);
                if was && self.clients[who].frozen.is_empty() {
                    let late = mix(&[self.schedule.seed, number as u64]).is_multiple_of(4);
                    self.catch_up(who, late);
                }
            }
            What::Crash { .. } | What::Leave(_) | What::Restart(_) => self.start(who),
            What::Break(server) => self.set_broken(server),
            _ => {}
        }
    }

    /// Tells a server's process whether its installation is broken now.
    pub(crate) fn set_broken(&self, server: usize) {
        let breaks = |one: &Disturbance| one.what == What::Break(server);
        let broken = self.active.iter().any(|(_, one)| breaks(one));
        if let Some(process) = &self.servers[server] {
            process.set_broken(broken);
        }
    }

    fn leave(&mut self, who: usize, server: usize) {
        if !self.is_well(who) {
            return;
        }
        let now = self.instant();
        let Some(process) = &mut self.servers[server] else {
            return;
        };
        let messages = process.leave(now);
        self.publish(who, messages);
        if let Some(connection) = self.clients[who].connection {
            self.send(connection, true, &Packet::Goodbye, 0);
        }
        self.kill(who, None);
    }

    fn interrupt(&mut self, who: usize, tool: usize) {
        let now = self.instant();
        let well = self.clients[who].alive && self.clients[who].frozen.is_empty();
        if !well || self.tools[tool].stage != Stage::Working {
            return;
        }
        if let Some(machine) = &mut self.tools[tool].machine {
            machine.cancel();
            self.tools[tool].stage = Stage::Thinking;
            let messages = self.tools[tool].act();
            self.publish(who, messages);
            self.clients[who].frozen.push(THINKS);
            let incarnation = self.clients[who].incarnation;
            self.plan(self.time(now) + MILLI, Event::Submit { who, incarnation });
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

    /// The broker has heard nothing of a client for long.
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
        let who = self.network.connections[connection].who;
        let client = &self.clients[who];
        if client.connection == Some(connection)
            && client.cut_off.contains(&cause)
            && client.frozen.is_empty()
        {
            self.send(connection, true, &Packet::Closed, 0);
            self.lose_connection(who);
        }
    }
}
