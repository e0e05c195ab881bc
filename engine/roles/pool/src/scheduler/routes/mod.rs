//! Routes of the scheduler: effects of messages, results and time on its parts.

mod agreement;
mod batched;
mod dispatch;
mod duplicates;
mod events;
mod failures;
mod offloaded;
mod requests;
mod results;
mod servers;
mod stepwise;
mod supervised;
mod work;
