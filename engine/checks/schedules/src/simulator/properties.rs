//! The properties that must hold, while a schedule runs and after it.

use std::rc::Rc;

use swarmwright_protocol::{Message, State, Topic, Topics};

use super::{Event, LOOK, Simulator};
use crate::schedule;
use crate::schedule::{Disturbance, MILLI, SECOND, Time, What, Who};
use crate::tool::{Stage, Tool};

/// How long a server may be idle and known while work waits: a round of discovery, and some time for messages.
pub const IDLE: Time = 3 * SECOND;
/// How much longer where a server may be taken for two.
const DOUBT: Time = 6 * SECOND;
/// Time for which a tool without work for a server keeps it reserved.
const HELD: Time = 5 * SECOND;

impl Simulator<'_> {
    pub(super) fn late(&mut self) {
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
                    "{} ({:?}): {state}; last warnings {:?}",
                    Who::Tool(index),
                    tool.stage,
                    tool.warnings
                )
            })
            .collect();
        self.violate(format!("work waits for ever: {}", tools.join("; ")));
    }

    pub(super) fn look(&mut self) {
        self.plan(self.now + LOOK, Event::Look);
        let harsh = self
            .active
            .iter()
            .any(|(_, disturbance)| disturbance.is_harsh() || disturbance.delays());
        for tool in 0..self.tools.len() {
            if let Err(text) = self.tools[tool].check_memory(self.servers.len()) {
                self.violate(format!("{}: {text}", Who::Tool(tool)));
            }
            let queued = self.tools[tool]
                .machine
                .as_ref()
                .map_or(0, |machine| machine.holdings().queued);
            for server in 0..self.servers.len() {
                let well = self.is_well(tool) && self.is_well(self.tools.len() + server);
                let alone = !self.schedule.has_twin(server);
                let expected =
                    queued > 0 && !harsh && well && alone && self.could_use(tool, server);
                for (free, bound) in [(true, IDLE), (false, IDLE + HELD)] {
                    let idle = expected && self.is_vacant(server, free);
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
                "{} has {} for {} ms while evaluations of {} waited: {}",
                Who::Server(server),
                if free {
                    "idled"
                } else {
                    "been held for nothing"
                },
                (self.now - since) / MILLI,
                Who::Tool(tool),
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

    /// Whether a server has left because another one has its id.
    fn has_given_way(&self, server: usize) -> bool {
        let id = self.schedule.id(server);
        let others = (0..self.servers.len()).filter(|other| *other != server);
        let mut others = others.filter(|other| self.schedule.id(*other) == id);
        others.any(|other| self.is_well(self.tools.len() + other))
    }

    /// When all is over: all servers are free, and say so.
    pub(super) fn check_rest(&mut self) {
        for index in 0..self.servers.len() {
            let peer = self.tools.len() + index;
            if !self.clients[peer].alive && self.has_given_way(index) {
                continue;
            }
            let Some(server) = self.servers[index].as_ref().filter(|_| self.is_well(peer)) else {
                let client = &self.clients[peer];
                return self.violate(format!(
                    "{} is not there at the end: {client:?}",
                    Who::Server(index)
                ));
            };
            if !server.is_free() {
                return self.violate(format!("{} is not free at the end", Who::Server(index)));
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
                    "what is retained of {} at the end is {presence:?}",
                    Who::Server(index)
                ));
            }
        }
        for tool in 0..self.tools.len() {
            if let Err(text) = self.tools[tool].check_memory(self.servers.len()) {
                self.violate(format!("{} at the end: {text}", Who::Tool(tool)));
            }
        }
    }
}
