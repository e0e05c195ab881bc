//! Packets on their way, and what the broker does with them.

use std::rc::Rc;

use crate::network::{Packet, Will};
use crate::schedule::Time;
use crate::simulator::{Event, Simulator};

impl Simulator<'_> {
    /// Puts a packet on its way.
    pub(crate) fn send(&mut self, connection: usize, up: bool, packet: &Packet, after: Time) {
        let peer = self.network.connections[connection].who;
        let hits = |disturbance: &crate::schedule::Disturbance| {
            disturbance
                .who()
                .is_some_and(|party| self.schedule.index(party) == peer)
        };
        let active: Vec<_> = self
            .active
            .iter()
            .filter(|(_, disturbance)| hits(disturbance))
            .cloned()
            .collect();
        for transfer in self
            .network
            .transmit(connection, up, packet, self.now + after, &active)
        {
            let event = Event::Arrive {
                connection: transfer.connection,
                up: transfer.up,
                packet: transfer.packet,
            };
            self.plan(transfer.at, event);
        }
    }

    pub(crate) fn arrive(&mut self, connection: usize, up: bool, packet: Packet) {
        let link = &self.network.connections[connection];
        let peer = link.who;
        if !self.clients[peer].cut_off.is_empty() {
            return self.clients[peer].held.push(Event::Arrive {
                connection,
                up,
                packet,
            });
        }
        if up {
            if self.network.up && link.broker_open {
                self.broker_hears(connection, packet);
            }
            return;
        }
        let client = &mut self.clients[peer];
        if !link.client_open || client.connection != Some(connection) {
            return;
        }
        if client.frozen.is_empty() {
            self.client_hears(peer, connection, packet);
        } else {
            client.backlog.push(Event::Arrive {
                connection,
                up,
                packet,
            });
        }
    }

    fn broker_hears(&mut self, connection: usize, packet: Packet) {
        match packet {
            Packet::Publish {
                topic,
                payload,
                retained,
            } => self.distribute(&topic, &payload, retained),
            Packet::Closed => self.broker_closes(connection, false),
            Packet::Goodbye => {
                self.network.connections[connection].will = None;
                self.broker_closes(connection, false);
            }
            Packet::Accepted => {}
        }
    }

    fn distribute(&mut self, topic: &Rc<str>, payload: &Rc<[u8]>, retain: bool) {
        let packet = Packet::Publish {
            topic: Rc::clone(topic),
            payload: Rc::clone(payload),
            retained: false,
        };
        for connection in self.network.route(topic, payload, retain) {
            self.send(connection, false, &packet, 0);
        }
    }

    /// The broker is through with a connection, and says the last will. `tells`: whether the client gets to know.
    pub(crate) fn broker_closes(&mut self, connection: usize, tells: bool) {
        let link = &mut self.network.connections[connection];
        if !std::mem::take(&mut link.broker_open) {
            return;
        }
        let will: Option<Will> = link.will.take();
        if tells {
            self.send(connection, false, &Packet::Closed, 0);
        }
        if let Some((topic, payload)) = will {
            self.note(|| format!("the broker says the last will of connection {connection}"));
            self.distribute(&topic, &payload, true);
        }
    }
}
