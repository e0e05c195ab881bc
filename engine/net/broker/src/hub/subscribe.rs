//! SUBSCRIBE and UNSUBSCRIBE: MQTT 5.0, chapters 3.8 to 3.11.

use super::complaints::Kind;
use super::lookups::Lookup;
use super::{Hub, WORK_OF_PACKET};
use crate::subscriptions::{DEEPEST, Options};
use std::time::Instant;
use swarmwright_packets::topic;
use swarmwright_packets::{Filter, Refusal, reason, suback, unsuback};

impl Hub {
    pub(super) fn subscribe(
        &mut self,
        id: usize,
        session: usize,
        packet: u16,
        identifier: Option<u32>,
        filters: &[Filter<'_>],
        now: Instant,
    ) -> Result<(), Refusal> {
        self.work += WORK_OF_PACKET * filters.len();
        let mut codes = Vec::with_capacity(filters.len());
        let mut lookups = Vec::new();
        for filter in filters {
            let code = match self.subscribe_to(session, identifier, filter) {
                Ok(is_new) => {
                    if filter.retain_handling == 0 || (filter.retain_handling == 1 && is_new) {
                        lookups.push(Lookup {
                            search: self.retained.search(filter.filter),
                            qos: filter.qos,
                            identifier,
                        });
                    }
                    filter.qos
                }
                Err(code) => code,
            };
            codes.push(code);
        }
        if codes.contains(&reason::QUOTA_EXCEEDED) {
            let complaint = "subscribes to more topic filters than a client may have";
            self.complain(Kind::Full, session, now, complaint);
        }
        self.routes.clear();
        self.recount_session(session);
        self.answer(id, |out, version| suback(out, packet, &codes, version))?;
        self.look_up(id, lookups, now);
        Ok(())
    }

    /// Adds one subscription. Returns whether it is new, or the reason code of a refusal.
    fn subscribe_to(
        &mut self,
        session: usize,
        identifier: Option<u32>,
        filter: &Filter<'_>,
    ) -> Result<bool, u8> {
        let name = filter.filter;
        if name.starts_with("$share/") {
            return Err(reason::NO_SHARED_SUBSCRIPTIONS);
        }
        if !topic::is_filter(name) || name.bytes().filter(|&byte| byte == b'/').count() >= DEEPEST {
            return Err(reason::BAD_FILTER);
        }
        let is_new = self.sessions[session]
            .subscribe(name)
            .ok_or(reason::QUOTA_EXCEEDED)?;
        let options = Options {
            qos: filter.qos,
            no_local: filter.no_local,
            retain_as_published: filter.retain_as_published,
            identifier,
        };
        self.subscriptions.add(session, name, options);
        Ok(is_new)
    }

    pub(super) fn unsubscribe(
        &mut self,
        id: usize,
        session: usize,
        packet: u16,
        filters: &[&str],
    ) -> Result<(), Refusal> {
        let mut codes = Vec::with_capacity(filters.len());
        for filter in filters {
            codes.push(if self.sessions[session].unsubscribe(filter) {
                self.subscriptions.remove(session, filter);
                reason::SUCCESS
            } else if topic::is_filter(filter) {
                reason::NO_SUBSCRIPTION
            } else {
                reason::BAD_FILTER
            });
        }
        self.routes.clear();
        self.recount_session(session);
        self.answer(id, |out, version| unsuback(out, packet, &codes, version))
    }
}
