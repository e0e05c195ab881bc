//! The packets that a session sends, built for its version of MQTT.

use mqtt_protocol_core::mqtt::packet::{
    ContentType, CorrelationData, MaximumPacketSize, MessageExpiryInterval, Packet, Property,
    ResponseTopic, SubEntry, SubOpts, v3_1_1, v5_0,
};
use mqtt_protocol_core::mqtt::result_code::MqttError;

use super::{QoS, Session, Subscription, Version};
use crate::dialect::Dialect;
use crate::plain;
use crate::publication::PublishOptions;
use crate::settings::Settings;

/// The largest packet that a broker may send here (MQTT 5), bytes: the protocol's largest message, its topic and properties.
const LARGEST_PACKET: u32 = (64 << 20) + (1 << 20);

impl Session {
    /// Puts the CONNECT packet into `out`.
    pub fn connect(
        &mut self,
        settings: &Settings,
        client_id: &str,
        dialect: Dialect,
        out: &mut Vec<u8>,
    ) -> Result<(), MqttError> {
        macro_rules! connect {
            ($module:ident) => {{
                let mut builder = $module::Connect::builder()
                    .client_id(client_id)?
                    .clean_start(true)
                    .keep_alive(settings.keep_alive);
                if let Some(username) = &settings.username {
                    builder = builder.user_name(username)?;
                    if let Some(password) = &settings.password {
                        builder = builder.password(password.as_bytes().to_vec())?;
                    }
                }
                if let Some(will) = &settings.will {
                    builder = builder.will_message(
                        &will.topic,
                        will.payload.clone(),
                        dialect.will_qos.into(),
                        will.retain && dialect.will_retained,
                    )?;
                }
                builder
            }};
        }
        let packet: Packet = match self.version {
            Version::V5 => {
                let mut builder =
                    connect!(v5_0).props(vec![MaximumPacketSize::new(LARGEST_PACKET)?.into()]);
                if let Some(will) = &settings.will {
                    builder =
                        builder.will_props(vec![MessageExpiryInterval::new(will.expiry)?.into()]);
                }
                builder.build()?.into()
            }
            Version::V3 => connect!(v3_1_1).build()?.into(),
        };
        self.send(packet, out)
    }

    pub fn subscribe(
        &mut self,
        subscriptions: &[Subscription],
        out: &mut Vec<u8>,
    ) -> Result<(), MqttError> {
        let entries = subscriptions
            .iter()
            .map(|subscription| {
                // This client does not need the messages that it publishes (MQTT 5).
                let options = SubOpts::new()
                    .set_qos(self.allowed(subscription.qos).into())
                    .set_nl(self.version == Version::V5);
                SubEntry::new(subscription.filter.as_str(), options)
            })
            .collect::<Result<Vec<_>, _>>()?;
        let id = self.core.acquire_packet_id()?;
        let packet: Packet = match self.version {
            Version::V5 => v5_0::Subscribe::builder()
                .packet_id(id)
                .entries(entries)
                .build()?
                .into(),
            Version::V3 => v3_1_1::Subscribe::builder()
                .packet_id(id)
                .entries(entries)
                .build()?
                .into(),
        };
        self.send(packet, out)
    }

    pub(super) fn publish_by_core(
        &mut self,
        topic: &str,
        payload: &[u8],
        options: &PublishOptions<'_>,
        out: &mut Vec<u8>,
    ) -> Result<(), MqttError> {
        let id = match options.qos {
            QoS::AtMostOnce => None,
            QoS::AtLeastOnce => Some(self.core.acquire_packet_id()?),
        };
        macro_rules! publish {
            ($module:ident) => {{
                let builder = $module::Publish::builder()
                    .topic_name(topic)?
                    .qos(options.qos.into())
                    .retain(options.retain)
                    .payload(payload);
                if let Some(id) = id {
                    builder.packet_id(id)
                } else {
                    builder
                }
            }};
        }
        let packet: Packet = match self.version {
            Version::V5 => {
                let mut properties: Vec<Property> = Vec::new();
                if let Some(seconds) = options.expiry {
                    properties.push(MessageExpiryInterval::new(seconds)?.into());
                }
                if let Some(text) = options.content_type {
                    properties.push(ContentType::new(text)?.into());
                }
                if let Some(topic) = options.response_topic {
                    // The library does not check it, and a broker would end the connection.
                    if !plain::is_topic(topic) {
                        return Err(MqttError::TopicNameInvalid);
                    }
                    properties.push(ResponseTopic::new(topic)?.into());
                }
                if let Some(data) = options.correlation {
                    properties.push(CorrelationData::new(data.to_vec())?.into());
                }
                let builder = publish!(v5_0);
                if properties.is_empty() {
                    builder.build()?.into()
                } else {
                    builder.props(properties).build()?.into()
                }
            }
            Version::V3 => publish!(v3_1_1).build()?.into(),
        };
        self.send(packet, out)?;
        self.unacknowledged.extend(id.map(|id| (id, topic.into())));
        Ok(())
    }

    pub fn disconnect(&mut self, out: &mut Vec<u8>) -> Result<(), MqttError> {
        let packet: Packet = match self.version {
            Version::V5 => v5_0::Disconnect::builder().build()?.into(),
            Version::V3 => v3_1_1::Disconnect::builder().build()?.into(),
        };
        self.send(packet, out)
    }
}
