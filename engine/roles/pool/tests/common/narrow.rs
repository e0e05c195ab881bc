//! A broker that ends the connection of a client that sends too large a message, without having announced the limit.

use std::time::{Duration, Instant};

use serde_json::{Value, json};
use swarmwright_protocol::Topics;

use super::{Extended, Message, Net, Party};

/// Time after which a client whose connection ended reconnects.
const BACK: Duration = Duration::from_millis(100);

impl Net {
    /// Reads a message as the broker. Returns whether it is accepted.
    pub(super) fn read(&mut self, message: &Message) -> bool {
        let (bytes, from) = (message.payload.len(), message.from);
        if bytes <= self.takes {
            if let Party::Tool(machine) = &mut self.parties[from] {
                machine.was_read(bytes);
            }
            return true;
        }
        self.cuts += 1;
        self.queues[from].clear();
        match &mut self.parties[from] {
            Party::Tool(machine) => {
                machine.ended_on(bytes, self.now);
                machine.disconnected(self.now);
                self.collect(from);
                self.queues[from].clear();
                self.now += BACK;
                let now = self.now;
                self.tool(from).connected(now);
                self.collect(from);
            }
            Party::Extended(server) => {
                let will = Message {
                    from,
                    topic: Topics::default().presence(server.id),
                    payload: server.presence("lost"),
                };
                server.cut(self.now);
                self.deliver(&will);
            }
            _ => panic!("party {from} sends {bytes} bytes"),
        }
        false
    }
}

impl Extended {
    fn presence(&self, state: &str) -> Vec<u8> {
        let announced: Value = json!({"version": 1, "modes": self.modes, "controllers": self.controllers,
            "batch": self.batch, "instance": self.instance});
        let presence = json!({"version": 1, "server": self.id, "state": state, "simulations": ["line"],
            "capabilities": {"dimensions": 2, "swarmwright": announced}, "since": "2026-01-01T00:00:00Z",
            "host": "here", "pid": 7, "instance": self.instance});
        presence.to_string().into_bytes()
    }

    /// Ends the connection and the current work, perhaps because the process has crashed.
    fn cut(&mut self, now: Instant) {
        self.outgoing.clear();
        self.batches.clear();
        self.busy_until = None;
        if self.crashes {
            self.instance.push('+');
        }
        let topic = Topics::default().presence(self.id);
        let ready = self.presence("ready");
        self.outgoing.push_back((now + BACK, topic, ready));
    }
}
