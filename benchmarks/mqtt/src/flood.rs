//! Saturation: each writer keeps up to `window` messages under way to the slowest of its readers.

use crate::{Failure, connection::Connection, options::Options, packet};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

type Part = JoinHandle<Result<(), String>>;

/// Sends `count` messages per pair and describes the rate as a JSON object.
pub fn run(options: &Options) -> Result<String, Failure> {
    let mut pairs = Vec::new();
    for pair in 0..options.pairs {
        let topic = options.topic_of(pair);
        let mut readers = Vec::new();
        for reader in 0..options.readers {
            readers.push(Connection::open(
                options,
                &format!("r{pair}-{reader}"),
                Some(&topic),
            )?);
        }
        let writer = Connection::open(options, &format!("w{pair}"), None)?;
        pairs.push((topic, writer, readers));
    }
    let start = Instant::now();
    let parts: Vec<Part> = pairs
        .into_iter()
        .map(|(topic, writer, readers)| {
            let message = packet::publish(&topic, &options.payload, options.five);
            let (count, window, batch) = (
                options.count,
                options.window,
                options.batch.min(options.window),
            );
            thread::spawn(move || flood(writer, readers, &message, (count, window, batch)))
        })
        .collect();
    for part in parts {
        part.join().map_err(|_| "a writing thread failed")??;
    }
    let seconds = start.elapsed().as_secs_f64();
    let messages = options.count as f64 * options.pairs as f64;
    Ok(format!(
        r#"{{"test":"flood","bytes":{},"count":{},"window":{},"batch":{},"pairs":{},"readers":{},"seconds":{seconds:.3},"messages_per_s":{:.0},"deliveries_per_s":{:.0}}}"#,
        options.payload.len(),
        options.count,
        options.window,
        options.batch,
        options.pairs,
        options.readers,
        messages / seconds,
        messages * options.readers as f64 / seconds,
    ))
}

fn flood(
    mut writer: Connection,
    readers: Vec<Connection>,
    message: &[u8],
    (count, window, batch): (u64, u64, u64),
) -> Result<(), String> {
    let me = thread::current();
    let mut arrived = Vec::new();
    let mut parts: Vec<Part> = Vec::new();
    for mut reader in readers {
        let counter = Arc::new(AtomicU64::new(0));
        arrived.push(Arc::clone(&counter));
        let me = me.clone();
        parts.push(thread::spawn(move || {
            while counter.load(Ordering::Relaxed) < count {
                let Some(more) = reader.publishes().map_err(|error| error.to_string())? else {
                    return Err(format!(
                        "{} of {count} messages, then none for 10 s: the broker lost the others",
                        counter.load(Ordering::Relaxed)
                    ));
                };
                counter.fetch_add(more, Ordering::Release);
                me.unpark();
            }
            Ok(())
        }));
    }
    let bytes = message.repeat(usize::try_from(batch).map_err(|error| error.to_string())?);
    let mut sent = 0;
    while sent < count {
        let slowest = arrived
            .iter()
            .map(|counter| counter.load(Ordering::Acquire))
            .min()
            .unwrap_or(0);
        let room = (slowest + window - sent).min(count - sent).min(batch);
        if room == 0 {
            if parts.iter().any(JoinHandle::is_finished) {
                break;
            }
            thread::park_timeout(Duration::from_millis(100));
            continue;
        }
        let length = message.len() * usize::try_from(room).unwrap_or(0);
        writer
            .write(&bytes[..length])
            .map_err(|error| error.to_string())?;
        sent += room;
    }
    for part in parts {
        part.join().map_err(|_| "a reading thread failed")??;
    }
    Ok(())
}
