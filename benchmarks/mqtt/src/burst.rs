//! Loss: a writer sends everything at once to a reader that does not read before the writer is done (or stuck).

use crate::{Failure, connection::Connection, options::Options, packet};
use std::io::Write;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

/// A writer that is held back this long is one that the broker slows down, which is not a loss.
const STUCK: Duration = Duration::from_secs(5);

/// Sends `count` messages and describes how many of them arrived as a JSON object.
pub fn run(options: &Options) -> Result<String, Failure> {
    let mut reader = Connection::open(options, "reader", Some(&options.topic))?;
    let writer = Connection::open(options, "writer", None)?;
    let message = packet::publish(&options.topic, &options.payload, options.five);
    let (done, is_done) = mpsc::channel();
    let count = options.count;
    let mut stream = writer.writer()?;
    let start = Instant::now();
    let writing = thread::spawn(move || {
        let all = (0..count).try_for_each(|_| stream.write_all(&message));
        // The broker may still be at work on the last of them.
        thread::sleep(Duration::from_millis(500));
        let _ = done.send(());
        all
    });
    let held_back = is_done.recv_timeout(STUCK).is_err();
    let written = start.elapsed().as_secs_f64();
    reader.patience(Duration::from_secs(3))?;
    let mut received = 0;
    while received < count {
        match reader.publishes()? {
            Some(more) => received += more,
            None => break,
        }
    }
    writing.join().map_err(|_| "the writing thread failed")??;
    Ok(format!(
        r#"{{"test":"burst","bytes":{},"count":{count},"received":{received},"lost":{},"writer_held_back":{held_back},"written_after_s":{written:.3},"seconds":{:.3}}}"#,
        options.payload.len(),
        count - received,
        start.elapsed().as_secs_f64(),
    ))
}
