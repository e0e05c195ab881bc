//! What follows an event: actions are carried out, timers set, the next work handed over.

use super::{Client, REVIVAL, THINKS};
use crate::network::Packet;
use crate::schedule::What;
use crate::server::Outgoing;
use crate::simulator::{Event, Simulator};
use crate::tool::{Stage, Tool};

impl Simulator<'_> {
    /// Does what a machine wants done, and sets its timer.
    pub(crate) fn after(&mut self, peer: usize) {
        if !self.clients[peer].alive {
            return;
        }
        let now = self.instant();
        let incarnation = self.clients[peer].incarnation;
        let (messages, next) = if let Some(index) = self.server_of(peer) {
            let slowness = self.slowness(index);
            let Some(server) = &mut self.servers[index] else {
                return;
            };
            if server.has_died() {
                self.note(|| format!("the simulation brings {} down", self.schedule.name(peer)));
                self.kill(peer, None);
                return self.plan(self.now + REVIVAL, Event::Start { who: peer });
            }
            let has_nothing = |tool: &Tool| {
                let machine = tool.machine.as_ref();
                machine.is_none_or(|machine| machine.has_nothing_on(server.id))
            };
            if server.job.is_some() || !self.tools.iter().all(has_nothing) {
                self.idle.retain(|(_, busy, _), _| *busy != index);
            }
            let (messages, begins) = server.act(slowness);
            if server.gives_way {
                return self.give_way(peer);
            }
            let (took, job, next) = (
                server.time(slowness),
                server.jobs,
                server.machine.next_tick(),
            );
            if begins {
                self.plan(
                    self.now + took,
                    Event::Done {
                        who: peer,
                        incarnation,
                        job,
                        took,
                    },
                );
            }
            (messages, next)
        } else {
            if let Err(text) = self.tools[peer].proceed(now) {
                self.violate(format!("{}: {text}", self.schedule.name(peer)));
            }
            let messages = self.tools[peer].act();
            self.advance(peer, incarnation);
            (
                messages,
                self.tools[peer]
                    .machine
                    .as_ref()
                    .map(|machine| machine.next_tick()),
            )
        };
        self.publish(peer, messages);
        if self
            .tools
            .get(peer)
            .is_some_and(|tool| tool.stage == Stage::Finished)
        {
            return self.retire(peer);
        }
        if let Some(at) = next.map(|at| self.time(at).max(self.now))
            && self.clients[peer].armed != Some(at)
        {
            self.clients[peer].armed = Some(at);
            self.plan(
                at,
                Event::Timer {
                    who: peer,
                    incarnation,
                },
            );
        }
    }

    pub(crate) fn publish(&mut self, peer: usize, messages: Vec<Outgoing>) {
        let client = &self.clients[peer];
        let Some(connection) = client.connection.filter(|_| client.ready) else {
            return;
        };
        for Outgoing {
            topic,
            payload,
            retain,
            after,
        } in messages
        {
            self.send(
                connection,
                true,
                &Packet::Publish {
                    topic,
                    payload,
                    retained: retain,
                },
                after,
            );
        }
    }

    /// A tool that has its results thinks of new work.
    pub(super) fn advance(&mut self, peer: usize, incarnation: u64) {
        let client = &mut self.clients[peer];
        let tool = &self.tools[peer];
        if tool.stage != Stage::Thinking
            || tool.machine.is_none()
            || !client.begun
            || client.frozen.contains(&THINKS)
        {
            return;
        }
        client.frozen.push(THINKS);
        let pause = tool.pause();
        self.plan(
            self.now + pause,
            Event::Submit {
                who: peer,
                incarnation,
            },
        );
    }

    /// A server whose id another one has leaves for good, and says nothing.
    pub(super) fn give_way(&mut self, peer: usize) {
        self.note(|| format!("{} gives way", self.schedule.name(peer)));
        if let Some(connection) = self.clients[peer].connection {
            self.send(connection, true, &Packet::Goodbye, 0);
        }
        self.kill(peer, None);
    }

    /// A tool that has all results frees the servers and leaves in good order.
    pub(super) fn retire(&mut self, peer: usize) {
        let Some(mut machine) = self.tools[peer].machine.take() else {
            return;
        };
        machine.release();
        self.tools[peer].machine = Some(machine);
        let messages = self.tools[peer].act();
        self.publish(peer, messages);
        if let Some(connection) = self.clients[peer].connection {
            self.send(connection, true, &Packet::Goodbye, 0);
        }
        self.note(|| format!("{} has all its results", self.schedule.name(peer)));
        self.clients[peer] = Client {
            incarnation: self.clients[peer].incarnation,
            ..Client::default()
        };
    }

    /// How many times as slow as planned a server is now.
    pub(super) fn slowness(&self, server: usize) -> u64 {
        let times = self
            .active
            .iter()
            .map(|(_, disturbance)| match disturbance.what {
                What::Slow {
                    server: slow,
                    times,
                } if slow == server => times,
                _ => 1,
            });
        times.max().unwrap_or(1)
    }
}
