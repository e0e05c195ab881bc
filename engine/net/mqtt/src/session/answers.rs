//! What the broker answers, and the limits that it announces.

use std::time::{Duration, Instant};

use swarmwright_packets::client::{Connack, Packet};
use swarmwright_packets::{Refusal, disconnect, reason};

use super::{Granted, Limits, MOST_AWAITED, MOST_UNACKNOWLEDGED, QoS, Received, Session, Stage};
use crate::dialect::Remedy;

/// Characters of a broker's own words that are repeated.
const LONGEST_TEXT: usize = 200;

pub(super) const NO_CONNACK: Refusal = Refusal::protocol("the answer to CONNECT is not a CONNACK");

impl Session {
    /// Takes a packet that is not a message.
    pub(super) fn handle(
        &mut self,
        packet: &Packet<'_>,
        received: &mut impl FnMut(Received),
    ) -> Result<(), Refusal> {
        match (packet, self.stage) {
            (Packet::Connack(connack), Stage::Connecting) => received(self.answered(connack)),
            (Packet::Connack(_), _) => return Err(Refusal::protocol("a second CONNACK")),
            // Brokers may not send it before CONNACK, but it says more than their closing the connection.
            (Packet::Disconnect { code, text }, _) => {
                self.stage = Stage::Over;
                let reason = match code {
                    0 => "the broker disconnected".to_owned(),
                    _ => format!("the broker disconnected: {}", describe(*code, *text)),
                };
                received(Received::Closed(reason));
            }
            (_, Stage::Connecting) => return Err(NO_CONNACK),
            (Packet::Puback { id, code, text }, _) => {
                let Some(topic) = self.unacknowledged.remove(id) else {
                    return Err(Refusal::protocol("a PUBACK for an unknown message"));
                };
                if *code == reason::NOT_AUTHORIZED {
                    received(Received::Denied(topic.into(), describe(*code, *text)));
                } else if *code >= reason::UNSPECIFIED {
                    // A quota that is used up, for instance: another time it may go well.
                    let reason = describe(*code, *text);
                    log::warn!("{topic:?}: the broker did not distribute a message ({reason})");
                }
            }
            (Packet::Suback { id, codes, text }, _) => {
                if self.subscribing.take() != Some((*id, codes.len())) {
                    return Err(Refusal::protocol(
                        "a SUBACK that does not match the SUBSCRIBE",
                    ));
                }
                let granted = codes.iter().map(|&code| {
                    if code < reason::UNSPECIFIED {
                        Granted::Yes
                    } else {
                        Granted::No(describe(code, *text))
                    }
                });
                received(Received::Subscribed(granted.collect()));
            }
            (Packet::Pong, _) => self.reading.answered(),
            // Taken elsewhere.
            (Packet::Publish(_), _) => {}
        }
        Ok(())
    }

    /// The broker accepts the connection, or refuses it.
    fn answered(&mut self, connack: &Connack<'_>) -> Received {
        if connack.code != reason::SUCCESS {
            self.stage = Stage::Over;
            let remedy = match connack.code {
                reason::UNSUPPORTED_VERSION => Remedy::Older,
                reason::QOS_NOT_SUPPORTED => Remedy::WillAtMostOnce,
                reason::NO_RETAIN => Remedy::WillNotRetained,
                reason::UNAVAILABLE | reason::BUSY | reason::CONNECTION_RATE => Remedy::Retry,
                _ => Remedy::None,
            };
            return Received::Refused(describe(connack.code, connack.text), remedy);
        }
        self.stage = Stage::Accepted;
        if let Some(seconds) = connack.keep_alive {
            self.patience = (seconds > 0).then(|| Duration::from_secs(seconds.into()));
        }
        self.ping_at = self.patience.map(|patience| Instant::now() + patience);
        let unacknowledged = usize::from(connack.receive_maximum);
        self.limits = Limits {
            largest: match connack.maximum_packet {
                u32::MAX => usize::MAX,
                bytes => usize::try_from(bytes).unwrap_or(usize::MAX),
            },
            unacknowledged: unacknowledged.min(MOST_UNACKNOWLEDGED),
            // Half of it is left for messages that have to be acknowledged.
            awaited: MOST_AWAITED.min(unacknowledged / 2),
            qos: if connack.maximum_qos == 0 {
                QoS::AtMostOnce
            } else {
                QoS::AtLeastOnce
            },
            retains: connack.retains,
        };
        Received::Accepted
    }

    /// Ends the connection, and says so where that is possible.
    pub(super) fn refuse(
        &mut self,
        refusal: Refusal,
        out: &mut Vec<u8>,
        received: &mut impl FnMut(Received),
    ) {
        let Refusal {
            reason,
            what: explanation,
        } = refusal;
        if self.stage == Stage::Accepted {
            disconnect(out, reason, explanation, self.version, self.limits.largest);
        }
        self.stage = Stage::Over;
        received(Received::Closed(format!(
            "MQTT protocol error: {explanation}"
        )));
    }
}

/// A reason code in words, and the broker's own.
fn describe(code: u8, text: Option<&str>) -> String {
    let mut words = reason::name(code).map_or_else(
        || format!("reason code 0x{code:02x}"),
        |name| name.to_owned(),
    );
    if let Some(text) = text.filter(|text| !text.is_empty()) {
        words.push_str(": ");
        for character in text.chars().take(LONGEST_TEXT) {
            match character {
                '"' | '\'' => words.push(character),
                // Nothing that a terminal would obey.
                _ => words.extend(character.escape_debug()),
            }
        }
    }
    words
}
