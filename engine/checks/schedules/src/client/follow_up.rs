//! What follows an event: actions are carried out, timers set, the next work handed over.

use super::{Client, REVIVAL, THINKS};
use crate::network::Packet;
use crate::schedule::What;
use crate::server::Outgoing;
use crate::simulator::{Event, Simulator};
use crate::tool::{Stage, Tool};

impl Simulator<'_> {
    /// Does what a machine wants done, and sets its timer.
    pub(crate) fn after(&mut self, who: usize) {
        if !self.clients[who].alive {
            return;
        }
        let now = self.instant();
        let incarnation = self.clients[who].incarnation;
        let (messages, next) = if let Some(index) = self.server_of(who) {
            let slowness = self.slowness(index);
            let Some(server) = &mut self.servers[index] else {
                return;
            };
            if server.has_died() {
                self.note(|| format!("the simulation brings {} down", self.schedule.name(who)));
                self.kill(who, None);
                return self.plan(self.now + REVIVAL, Event::Start { who });
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
                return self.give_way(who);
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
                        who,
                        incarnation,
                        job,
                        took,
                    },
                );
            }
            (messages, next)
        } else {
            if let Err(text) = self.tools[who].proceed(now) {
                self.violate(format!("{}: {text}", self.schedule.name(who)));
            }
            let messages = self.tools[who].act();
            self.advance(who, incarnation);
            (
                messages,
                self.tools[who]
                    .machine
                    .as_ref()
                    .map(|machine| machine.next_tick()),
            )
        };
        self.publish(who, messages);
        if self
            .tools
            .get(who)
            .is_some_and(|tool| tool.stage == Stage::Finished)
        {
            return self.retire(who);
        }
        if let Some(at) = next.map(|at| self.time(at).max(self.now))
            && self.clients[who].armed != Some(at)
        {
            self.clients[who].armed = Some(at);
            self.plan(at, Event::Timer { who, incarnation });
        }
    }

    pub(crate) fn publish(&mut self, who: usize, messages: Vec<Outgoing>) {
        let client = &self.clients[who];
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
    pub(super) fn advance(&mut self, who: usize, incarnation: u64) {
        let client = &mut self.clients[who];
        let tool = &self.tools[who];
        if tool.stage != Stage::Thinking
            || tool.machine.is_none()
            || !client.begun
            || client.frozen.contains(&THINKS)
        {
            return;
        }
        client.frozen.push(THINKS);
        let pause = tool.pause();
        self.plan(self.now + pause, Event::Submit { who, incarnation });
    }

    /// A server whose id another one has leaves for good, and says nothing.
    pub(super) fn give_way(&mut self, who: usize) {
        self.note(|| format!("{} gives way", self.schedule.name(who)));
        if let Some(connection) = self.clients[who].connection {
            self.send(connection, true, &Packet::Goodbye, 0);
        }
        self.kill(who, None);
    }

    /// A tool that has all results frees the servers and leaves in good order.
    pub(super) fn retire(&mut self, who: usize) {
        let Some(mut machine) = self.tools[who].machine.take() else {
            return;
        };
        machine.release();
        self.tools[who].machine = Some(machine);
        let messages = self.tools[who].act();
        self.publish(who, messages);
        if let Some(connection) = self.clients[who].connection {
            self.send(connection, true, &Packet::Goodbye, 0);
        }
        self.note(|| format!("{} has all its results", self.schedule.name(who)));
        self.clients[who] = Client {
            incarnation: self.clients[who].incarnation,
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
