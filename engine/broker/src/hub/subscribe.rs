//! SUBSCRIBE and UNSUBSCRIBE: MQTT 5.0, chapters 3.8 to 3.11.

use super::Hub;
use crate::codec::{Filter, Refusal, reason, suback, unsuback};
use crate::session::{Delivery, Subscription};
use crate::topic;
use std::sync::Arc;
use std::time::Instant;

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
        let mut codes = Vec::with_capacity(filters.len());
        let mut wanted = Vec::new();
        for filter in filters {
            if filter.filter.starts_with("$share/") {
                codes.push(reason::NO_SHARED_SUBSCRIPTIONS);
                continue;
            }
            if !topic::is_filter(filter.filter) {
                codes.push(reason::BAD_FILTER);
                continue;
            }
            let is_new = self.sessions[session].subscribe(Subscription {
                filter: filter.filter.into(),
                qos: filter.qos,
                no_local: filter.no_local,
                retain_as_published: filter.retain_as_published,
                identifier,
            });
            codes.push(filter.qos);
            if filter.retain_handling == 0 || (filter.retain_handling == 1 && is_new) {
                wanted.push(filter);
            }
        }
        self.routes.clear();
        let link = &mut self.links[id];
        suback(link.out.end(), packet, &codes, link.terms.version);
        self.mark(id);
        for filter in wanted {
            self.send_retained(id, session, filter, identifier, now);
        }
        Ok(())
    }

    fn send_retained(
        &mut self,
        id: usize,
        session: usize,
        filter: &Filter<'_>,
        identifier: Option<u32>,
        now: Instant,
    ) {
        for message in self.retained.matching(filter.filter, now) {
            if !self.may_read(session, &message.topic) {
                continue;
            }
            let qos = message.qos.min(filter.qos);
            let delivery = Delivery {
                message: Arc::clone(&message),
                qos,
                retain: true,
                identifiers: identifier.into_iter().collect(),
            };
            let (link, remembered) = (&mut self.links[id], &mut self.sessions[session]);
            let fits = if qos == 0 {
                delivery.send(&mut link.out, link.terms, now);
                link.out.len() <= self.limits.backlog
            } else {
                remembered.enqueue(delivery, self.limits.backlog)
            };
            if !fits {
                self.doomed.push(id);
                return;
            }
            remembered.advance(&mut link.out, link.terms, now);
        }
    }

    pub(super) fn unsubscribe(&mut self, id: usize, session: usize, packet: u16, filters: &[&str]) {
        let remembered = &mut self.sessions[session];
        let codes: Vec<u8> = filters
            .iter()
            .map(|filter| {
                if remembered.unsubscribe(filter) {
                    reason::SUCCESS
                } else {
                    reason::NO_SUBSCRIPTION
                }
            })
            .collect();
        self.routes.clear();
        let link = &mut self.links[id];
        unsuback(link.out.end(), packet, &codes, link.terms.version);
        self.mark(id);
    }
}
