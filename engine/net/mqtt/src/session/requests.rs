//! Requests that begin and end a session.

use swarmwright_packets::client::{self, DISCONNECT, Invalid, Properties};
use swarmwright_packets::{Connect, Filter, Version, Will};

use super::{LARGEST_PACKET, Session, Subscription};
use crate::dialect::Dialect;
use crate::settings::Settings;

impl Session {
    /// Appends the CONNECT packet to `out`.
    pub fn connect(
        &mut self,
        settings: &Settings,
        client_id: &str,
        dialect: Dialect,
        out: &mut Vec<u8>,
    ) -> Result<(), Invalid> {
        let will = match &settings.will {
            None => None,
            Some(will) => Some(Will {
                topic: &will.topic,
                payload: &will.payload,
                properties: Properties {
                    expiry: Some(will.expiry),
                    ..Properties::default()
                }
                .encoded()?,
                qos: dialect.will_qos as u8,
                retain: will.retain && dialect.will_retained,
                delay: 0,
            }),
        };
        let user = settings.username.as_deref();
        let packet = Connect {
            version: self.version,
            client_id,
            clean: true,
            keep_alive: settings.keep_alive,
            session_expiry: 0,
            receive_maximum: u16::MAX,
            maximum_packet: LARGEST_PACKET,
            will,
            user,
            password: user.and(settings.password.as_deref().map(str::as_bytes)),
        };
        client::connect(out, &packet)
    }

    /// Appends a SUBSCRIBE packet to `out`; the next one must wait for the answer.
    pub fn subscribe(
        &mut self,
        subscriptions: &[Subscription],
        out: &mut Vec<u8>,
    ) -> Result<(), Invalid> {
        let filters: Vec<_> = subscriptions
            .iter()
            .map(|subscription| Filter {
                filter: &subscription.filter,
                qos: subscription.qos.min(self.limits.qos) as u8,
                // This client does not need the messages that it publishes.
                no_local: self.version == Version::Five,
                retain_as_published: false,
                retain_handling: 0,
            })
            .collect();
        let id = self.fresh_id();
        client::subscribe(out, id, &filters, self.version)?;
        self.subscribing = Some((id, filters.len()));
        Ok(())
    }

    /// Appends the DISCONNECT packet of an orderly end to `out`.
    pub fn disconnect(out: &mut Vec<u8>) {
        out.extend_from_slice(&DISCONNECT);
    }
}
