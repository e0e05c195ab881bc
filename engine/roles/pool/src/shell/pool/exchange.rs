//! Exchange with the broker: carries out the scheduler's actions, and passes messages and time to it.

use std::time::{Duration, Instant, SystemTime};

use swarmwright_mqtt::{Event, PublishOptions, TooLarge};

use swarmwright_protocol::Topic;

use super::Pool;
use crate::journal::Warning;
use crate::scheduler::Action;
use crate::shell::report::Report;

/// Time without polling after which messages are read before any server is considered late.
const SUSPENDED: Duration = Duration::from_millis(300);

impl Pool {
    /// Sends and receives messages until `until` at the latest.
    pub(super) fn poll(&mut self, until: Instant) {
        let now = Instant::now();
        // This process was stopped or the machine was suspended; the servers were not silent, but their messages are
        // unread.
        let suspended = now.duration_since(self.looked) >= SUSPENDED;
        let deadline = now + SUSPENDED;
        while suspended && self.hear(now) && self.looked < deadline {}
        if let Some(slowdown) = self.load.look(now) {
            self.scheduler.set_slowdown(slowdown);
        }
        let mut wake = until;
        if now < self.ask_at {
            wake = wake.min(self.ask_at);
        } else {
            self.ask_tick(now);
        }
        if self.tick_at <= now {
            self.scheduler.tick(now);
            self.ask_tick(now);
        }
        if self.tell_at <= now {
            self.tell(false, now);
        }
        if self.count_at <= now {
            self.count_alike(now);
        }
        self.take_reports(now);
        self.act();
        self.hear(wake.min(self.tick_at));
        self.take_reports(Instant::now());
        self.act();
        self.reporter.look(&self.scheduler, self.wall, self.looked);
    }

    /// Takes the reports of the supervisor, and the result of a probe of the broker.
    fn take_reports(&mut self, now: Instant) {
        let (endings, alive) = self.supervision.take();
        for server in alive {
            self.scheduler.is_alive(server, now);
        }
        for ending in endings {
            self.scheduler.ended(&ending, now);
        }
        if let Some(answer) = self.probe.take() {
            self.scheduler
                .broker_holds_back(answer, &self.connection.url());
        }
    }

    fn ask_tick(&mut self, now: Instant) {
        self.tick_at = self.scheduler.next_tick();
        self.ask_at = now + self.scheduler.tick_query_interval();
    }

    /// Receives messages until `until`, or until some arrive. Returns whether any arrived.
    fn hear(&mut self, until: Instant) -> bool {
        self.connection.poll(until, &mut self.events);
        let now = Instant::now();
        self.looked = now;
        let came = !self.events.is_empty();
        let read = self.connection.largest_read();
        if std::mem::replace(&mut self.read, read) < read {
            self.scheduler.was_read(read);
        }
        let unread = |event: &Event| match event {
            Event::Disconnected { unread, .. } => Some(*unread),
            _ => None,
        };
        if let Some(unread) = self.events.iter().find_map(unread) {
            self.suspect(unread, now);
        }
        let mut denied = Vec::new();
        for event in self.events.drain(..) {
            match event {
                Event::Message(message) => {
                    self.reporter
                        .heard(&self.scheduler, message.topic(), message.payload());
                    self.scheduler.receive(
                        message.topic(),
                        message.payload(),
                        message.retained(),
                        now,
                    );
                }
                Event::Connected => {
                    self.warnings
                        .push(Warning::now("the broker is back".to_owned()));
                    self.reporter.tell(&Report::BrokerBack);
                    self.outages.back(now, SystemTime::now());
                    self.scheduler
                        .set_largest_packet(self.connection.largest_packet());
                    self.scheduler.connected(now);
                }
                Event::Disconnected { reason, .. } => {
                    self.reporter.tell(&Report::BrokerLost { reason: &reason });
                    self.outages.lost(&reason, now, SystemTime::now());
                    let text = format!("lost the broker ({reason}); trying again");
                    self.warnings.push(Warning::now(text));
                    self.scheduler.disconnected(now);
                }
                Event::Denied { topic, message } => denied.push((topic, message)),
            }
        }
        for (topic, message) in denied {
            self.is_denied(&topic, message);
        }
        came
    }

    pub(super) fn act(&mut self) {
        let mut unsent = Vec::new();
        let mut sent = Vec::new();
        for action in self.scheduler.actions() {
            match action {
                Action::Publish(topic, payload) => {
                    let options = PublishOptions {
                        // A server would take a second copy for the next step.
                        confirm: topic != Topic::Actuator,
                        ..PublishOptions::default()
                    };
                    let name = self.topics.name(topic);
                    self.connection.publish_logged(&name, &payload, &options);
                }
                Action::Control { server, payload } => {
                    let name = self.topics.to_server(server);
                    self.connection
                        .publish_logged(&name, &payload, &PublishOptions::CONFIRMED);
                }
                Action::Request {
                    server,
                    request,
                    payload,
                } => {
                    let options = PublishOptions {
                        content_type: Some("application/msgpack"),
                        response_topic: Some(&self.reply),
                        correlation: Some(&request.to_be_bytes()),
                        ..PublishOptions::CONFIRMED
                    };
                    let topic = self.topics.to_server(server);
                    sent.push(request);
                    if let Err(TooLarge { bytes, most }) =
                        self.connection.publish_with(&topic, &payload, &options)
                    {
                        unsent.push((request, format!("a request of {bytes} bytes is larger than the {most} that the broker \
                             accepts")));
                    }
                }
                Action::Warn(text) => {
                    self.reporter.tell(&Report::Warning { message: &text });
                    self.warnings.push(Warning::now(text));
                }
                Action::Unaudited(text) => {
                    self.reporter.tell(&Report::Warning { message: &text });
                    self.warnings.push(Warning {
                        unaudited: true,
                        ..Warning::now(text)
                    });
                }
                Action::Failed {
                    evaluation,
                    text,
                    first,
                } => {
                    if first {
                        self.reporter.tell(&Report::Warning { message: &text });
                    }
                    self.warnings.push(Warning {
                        failed: Some(evaluation),
                        ..Warning::now(text)
                    });
                }
                Action::Overdue(server) => self.supervision.is_overdue(server),
                Action::AskBroker => self.probe.ask(),
            }
        }
        for request in sent {
            if let Some((candidate, episode)) = self.scheduler.place(request) {
                self.supervision.sent(request, candidate, episode);
            }
        }
        for (request, reason) in unsent {
            self.scheduler.unsent(request, &reason, Instant::now());
        }
    }
}
