//! Events of the protocol library, and the limits that the broker announces.

use std::time::{Duration, Instant};

use mqtt_protocol_core::mqtt::connection::{Event as CoreEvent, TimerKind};
use mqtt_protocol_core::mqtt::packet::{Packet, Property};
use mqtt_protocol_core::mqtt::prelude::*;
use mqtt_protocol_core::mqtt::result_code::{
    ConnectReasonCode, ConnectReturnCode, PubackReasonCode,
};

use super::messages::Publish;
use super::{Granted, Incoming, MOST_AWAITED, QoS, Received, Session};
use crate::dialect::Remedy;

impl Session {
    pub(super) fn handle(
        &mut self,
        event: CoreEvent,
        out: &mut Vec<u8>,
        received: &mut impl FnMut(Received),
    ) {
        match event {
            CoreEvent::RequestSendPacket { packet, .. } => {
                if matches!(packet, Packet::V5_0Pingreq(_) | Packet::V3_1_1Pingreq(_)) {
                    self.reading.asked(0);
                }
                for buffer in packet.to_buffers() {
                    out.extend_from_slice(&buffer);
                }
            }
            CoreEvent::RequestTimerReset { kind, duration_ms } => {
                if let Some(timer) = self.timer(kind) {
                    *timer = Some(Instant::now() + Duration::from_millis(duration_ms));
                }
            }
            CoreEvent::RequestTimerCancel(kind) => {
                if let Some(timer) = self.timer(kind) {
                    *timer = None;
                }
            }
            CoreEvent::NotifyPacketReceived(packet) => match packet {
                Packet::V5_0Publish(publish) => {
                    received(Received::Publish(Incoming(Publish::V5(Box::new(publish)))))
                }
                Packet::V3_1_1Publish(publish) => {
                    received(Received::Publish(Incoming(Publish::V3(Box::new(publish)))))
                }
                Packet::V5_0Pingresp(_) | Packet::V3_1_1Pingresp(_) => self.reading.answered(),
                Packet::V5_0Connack(connack) => received(match connack.reason_code() {
                    ConnectReasonCode::Success => {
                        self.accepted = true;
                        self.limit(connack.props());
                        Received::Accepted
                    }
                    code => Received::Refused(
                        code.to_string(),
                        match code {
                            ConnectReasonCode::UnsupportedProtocolVersion => Remedy::Older,
                            ConnectReasonCode::QosNotSupported => Remedy::WillAtMostOnce,
                            ConnectReasonCode::RetainNotSupported => Remedy::WillNotRetained,
                            ConnectReasonCode::ServerBusy
                            | ConnectReasonCode::ServerUnavailable
                            | ConnectReasonCode::ConnectionRateExceeded => Remedy::Retry,
                            _ => Remedy::None,
                        },
                    ),
                }),
                Packet::V3_1_1Connack(connack) => received(match connack.return_code() {
                    ConnectReturnCode::Accepted => {
                        self.accepted = true;
                        Received::Accepted
                    }
                    ConnectReturnCode::ServerUnavailable => {
                        Received::Refused("it is not available".to_owned(), Remedy::Retry)
                    }
                    code => Received::Refused(code.to_string(), Remedy::None),
                }),
                Packet::V5_0Suback(suback) => {
                    received(Received::Subscribed(
                        suback
                            .reason_codes()
                            .into_iter()
                            .map(|code| Granted::by(code as u8, code))
                            .collect(),
                    ));
                }
                Packet::V3_1_1Suback(suback) => {
                    received(Received::Subscribed(
                        suback
                            .return_codes()
                            .into_iter()
                            .map(|code| Granted::by(code as u8, code))
                            .collect(),
                    ));
                }
                Packet::V5_0Puback(puback) => {
                    let topic = self.acknowledged(puback.packet_id());
                    match (topic, puback.reason_code()) {
                        (Some(topic), Some(code @ PubackReasonCode::NotAuthorized)) => {
                            received(Received::Denied(topic.into(), code.to_string()));
                        }
                        // A quota that is used up, for instance: another time it may go well.
                        (Some(topic), Some(code)) if code.is_failure() => {
                            log::warn!(
                                "{topic:?}: the broker did not distribute a message ({code})"
                            );
                        }
                        _ => {}
                    }
                }
                Packet::V3_1_1Puback(puback) => {
                    self.acknowledged(puback.packet_id());
                }
                Packet::V5_0Disconnect(disconnect) => {
                    self.over = true;
                    received(Received::Closed(disconnect.reason_code().map_or_else(
                        || "the broker disconnected".to_owned(),
                        |code| code.to_string(),
                    )))
                }
                _ => {}
            },
            CoreEvent::NotifyError(error) => {
                self.over = true;
                received(Received::Closed(format!("MQTT protocol error: {error:?}")))
            }
            CoreEvent::RequestClose => {
                self.over = true;
                received(Received::Closed("the MQTT protocol requires it".to_owned()))
            }
            CoreEvent::NotifyPacketIdReleased(_) => {}
        }
    }

    /// The topic of a message that the broker has acknowledged.
    fn acknowledged(&mut self, id: u16) -> Option<Box<str>> {
        let place = self.unacknowledged.iter().position(|(one, _)| *one == id)?;
        Some(self.unacknowledged.swap_remove(place).1)
    }

    /// Adopts the limits that the broker announces.
    fn limit(&mut self, properties: &[Property]) {
        for property in properties {
            match property {
                Property::MaximumPacketSize(size) => {
                    self.largest = usize::try_from(size.val()).unwrap_or(usize::MAX);
                }
                // Half of it is left for messages that have to be acknowledged.
                Property::ReceiveMaximum(most) => {
                    self.awaited = MOST_AWAITED.min(usize::from(most.val()) / 2);
                }
                Property::MaximumQos(most) if most.val() == 0 => self.most = QoS::AtMostOnce,
                Property::RetainAvailable(retains) => self.retains = retains.val() == 1,
                _ => {}
            }
        }
    }

    fn timer(&mut self, kind: TimerKind) -> Option<&mut Option<Instant>> {
        match kind {
            TimerKind::PingreqSend => Some(&mut self.ping_at),
            TimerKind::PingrespRecv | TimerKind::PingreqRecv => None,
        }
    }
}
