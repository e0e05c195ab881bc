//! Connections under test, with a limit on the time that each wait takes.
#![allow(clippy::unwrap_used, clippy::panic, dead_code)] // helpers of tests

use std::time::{Duration, Instant};

use swarmwright_mqtt::{Connection, Event, QoS, Settings, Subscription};

pub const PATIENCE: Duration = Duration::from_secs(10);

pub fn settings(url: &str) -> Settings {
    let mut settings = Settings::new(url.parse().unwrap());
    settings.timeout = Duration::from_millis(500);
    settings
}

pub fn subscription(filter: &str) -> Vec<Subscription> {
    vec![Subscription {
        filter: filter.into(),
        qos: QoS::AtLeastOnce,
    }]
}

pub fn open(url: &str, filter: &str) -> Connection {
    Connection::open(settings(url), subscription(filter)).unwrap()
}

/// Polls until `count` messages have arrived.
pub fn messages(connection: &mut Connection, count: usize) -> Vec<(String, Vec<u8>, bool)> {
    let deadline = Instant::now() + PATIENCE;
    let mut messages = Vec::new();
    let mut events = Vec::new();
    while messages.len() < count {
        assert!(
            Instant::now() < deadline,
            "{} of {count} messages came",
            messages.len()
        );
        connection.poll(deadline, &mut events);
        for event in events.drain(..) {
            if let Event::Message(message) = event {
                messages.push((
                    message.topic().to_owned(),
                    message.payload().to_vec(),
                    message.retained(),
                ));
            }
        }
    }
    messages
}

/// Polls until an event of a kind has arrived.
pub fn until(connection: &mut Connection, is_wanted: impl Fn(&Event) -> bool) {
    let deadline = Instant::now() + PATIENCE;
    let mut events = Vec::new();
    while !events.drain(..).any(|event| is_wanted(&event)) {
        assert!(Instant::now() < deadline, "the event did not come");
        connection.poll(deadline, &mut events);
    }
}
