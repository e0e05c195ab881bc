//! Handshakes, CONNECT and SUBSCRIBE with their acknowledgements, repeated with other options if the broker requires
//! it.

use std::io::{self, ErrorKind};
use std::thread;
use std::time::{Duration, Instant};

use crate::connection::Event;
use crate::dialect::{Dialect, Remedy};
use crate::session::{Granted, Received, Session, Subscription, Version};
use crate::settings::Settings;
use crate::transport::Transport;
use crate::{ConnectError, MOST_TRIES, tls};

/// Share of the time-out after which 3.1.1 is tried if the broker does not answer MQTT 5.
const SILENCE: f64 = 0.6;
/// Pause after a connection that was accepted and then closed; it grows with each.
const PAUSE: Duration = Duration::from_millis(100);
/// How long a broker may take to restart after it closed a connection and became unreachable.
const RESTART: Duration = Duration::from_secs(5);

/// A failed attempt, and a change that may help.
struct Failure(ConnectError, Remedy);

/// Client that connects, and its subscriptions.
pub(crate) struct Caller<'a> {
    pub settings: &'a Settings,
    pub client_id: &'a str,
    pub subscriptions: &'a [Subscription],
    /// Whether to wait for a broker that is restarting.
    pub waits: bool,
}

/// Connects and subscribes. Messages that arrive with the subscription are left in `early`, and unsent bytes in `out`.
pub(crate) fn connect(
    caller: &Caller<'_>,
    chunk: &mut [u8],
    out: &mut Vec<u8>,
    early: &mut Vec<Event>,
) -> Result<(Transport, Session), ConnectError> {
    let forced = caller.settings.url.version;
    let address = caller.settings.url.to_string();
    let learnt = Dialect::learnt(&address)
        .filter(|learnt| forced.is_none_or(|version| version == learnt.version));
    let mut dialect = learnt.unwrap_or_else(|| Dialect::first(forced));
    let mut broken = 0;
    // Time limit for the restart of a broker that was reachable before.
    let mut restarts_until: Option<Instant> = None;
    loop {
        early.clear();
        out.clear();
        let Failure(error, remedy) = match attempt(caller, dialect, chunk, out, early) {
            Ok(connection) => {
                dialect.learn(&address);
                return Ok(connection);
            }
            Err(failure) => failure,
        };
        if matches!(error, ConnectError::NoBroker { .. }) {
            if restarts_until.is_some_and(|until| Instant::now() < until) {
                log::debug!("{error}");
                thread::sleep(PAUSE);
                // The earlier failures were due to the restart, so start over.
                dialect = learnt.unwrap_or_else(|| Dialect::first(forced));
                broken = 0;
                continue;
            }
        } else if caller.waits {
            restarts_until.get_or_insert_with(|| Instant::now() + RESTART);
        }
        if remedy == Remedy::Retry {
            broken += 1;
            if broken >= MOST_TRIES {
                return Err(error);
            }
            log::debug!("{error}");
            thread::sleep(PAUSE * broken);
        }
        let Some(next) = dialect.after(remedy, forced) else {
            if !matches!(error, ConnectError::NoBroker { .. }) {
                Dialect::forget(&address);
            }
            return Err(error);
        };
        dialect = next;
    }
}

fn attempt(
    caller: &Caller<'_>,
    dialect: Dialect,
    chunk: &mut [u8],
    out: &mut Vec<u8>,
    early: &mut Vec<Event>,
) -> Result<(Transport, Session), Failure> {
    let settings = caller.settings;
    let url = settings.url.to_string();
    let mut accepted = false;
    // A server that has accepted the connection is certainly a broker.
    let broken = |accepted: bool, reason: String| {
        let url = url.clone();
        if accepted {
            Failure(ConnectError::Broken { url, reason }, Remedy::Retry)
        } else {
            Failure(ConnectError::NoMqtt { url, reason }, Remedy::Older)
        }
    };
    let mut transport =
        Transport::connect(settings).map_err(|error| Failure(error, Remedy::None))?;
    let silence = match (dialect.version, settings.url.version) {
        (Version::Five, None) => settings.timeout.mul_f64(SILENCE),
        _ => settings.timeout,
    };
    transport
        .set_read_timeout(silence)
        .map_err(|error| broken(false, error.to_string()))?;
    let mut session = Session::new(dialect.version, settings.keep_alive);
    session
        .connect(settings, caller.client_id, dialect, out)
        .map_err(|error| {
            let (url, user) = (url.clone(), settings.who());
            let reason = error.to_string();
            Failure(ConnectError::Refused { url, user, reason }, Remedy::None)
        })?;
    let deadline = Instant::now() + settings.timeout;
    let unusable = |accepted: bool, error: &io::Error| match tls::refused(error, settings) {
        Some(refused) if !accepted => Failure(refused, Remedy::None),
        _ => broken(accepted, error.to_string()),
    };
    let mut answers = Vec::new();
    let mut ready = false;
    loop {
        if let Err(error) = send(&mut transport, out) {
            // The broker may have sent a reason before it closed the connection.
            let reply_error = transport.read(chunk).err();
            return Err(unusable(accepted, &reply_error.unwrap_or(error)));
        }
        let late = || broken(accepted, "no answer in time".to_owned());
        if Instant::now() > deadline {
            return Err(late());
        }
        let count = match transport.read(chunk) {
            Ok(0) => return Err(broken(accepted, "it closed the connection".to_owned())),
            Ok(count) => count,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                return Err(late());
            }
            Err(error) => return Err(unusable(accepted, &error)),
        };
        session.receive(&chunk[..count], out, &mut |received| answers.push(received));
        for answer in answers.drain(..) {
            match answer {
                Received::Accepted => {
                    accepted = true;
                    if caller.subscriptions.is_empty() {
                        ready = true;
                        continue;
                    }
                    session
                        .subscribe(caller.subscriptions, out)
                        .map_err(|error| broken(true, error.to_string()))?;
                }
                Received::Refused(reason, Remedy::Retry) => {
                    return Err(Failure(ConnectError::Busy { url, reason }, Remedy::Retry));
                }
                Received::Refused(reason, remedy) => {
                    let user = settings.who();
                    return Err(Failure(ConnectError::Refused { url, user, reason }, remedy));
                }
                Received::Subscribed(granted) => {
                    if let Some(index) = granted.iter().position(|grant| *grant != Granted::Yes) {
                        return Err(denied(caller, index, &granted[index]));
                    }
                    ready = true;
                }
                Received::Publish(message) => early.push(Event::Message(message)),
                Received::Denied(..) => {}
                Received::Closed(reason) => {
                    // Send the reason to the broker.
                    let _ = send(&mut transport, out);
                    return Err(broken(accepted, reason));
                }
            }
        }
        // Return only after all answers are handled, because retained messages arrive together with the last one.
        if ready {
            return Ok((transport, session));
        }
    }
}

fn send(transport: &mut Transport, out: &mut Vec<u8>) -> io::Result<()> {
    while !out.is_empty() {
        let count = transport.write(out)?;
        out.drain(..count);
    }
    transport.flush()
}

fn denied(caller: &Caller<'_>, index: usize, granted: &Granted) -> Failure {
    let filter = caller.subscriptions.get(index);
    let reason = match granted {
        Granted::No(reason) => reason.clone(),
        Granted::Yes => String::new(),
    };
    let error = ConnectError::Denied {
        url: caller.settings.url.to_string(),
        user: caller.settings.who(),
        filter: filter.map_or_else(String::new, |subscription| subscription.filter.clone()),
        reason,
    };
    Failure(error, Remedy::None)
}
