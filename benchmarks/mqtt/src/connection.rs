//! One blocking connection, TCP_NODELAY set.

use crate::{Failure, options::Options, packet};
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// A connection with the bytes that have arrived and are not yet cut into packets.
pub struct Connection {
    stream: TcpStream,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
}

impl Connection {
    /// Connects and, unless `--raw`, introduces itself and subscribes to `filter`.
    pub fn open(options: &Options, name: &str, filter: Option<&str>) -> Result<Self, Failure> {
        let place = (options.host.as_str(), options.port);
        let stream = TcpStream::connect(place).map_err(|error| {
            format!(
                "no connection to {}:{}: {error}",
                options.host, options.port
            )
        })?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(Duration::from_secs(10)))?;
        let mut connection = Self {
            stream,
            buffer: vec![0; 1 << 18],
            start: 0,
            end: 0,
        };
        if options.raw {
            return Ok(connection);
        }
        let client = format!("bare-{}-{name}", std::process::id());
        connection.write(&packet::connect(&client, options.five))?;
        connection.await_kind(2, "CONNACK")?;
        if let Some(filter) = filter {
            connection.write(&packet::subscribe(filter, options.five))?;
            connection.await_kind(9, "SUBACK")?;
        }
        Ok(connection)
    }

    /// Sends bytes as they are.
    pub fn write(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        Ok(self.stream.write_all(bytes)?)
    }

    /// A second handle on the same socket, for writing.
    pub fn writer(&self) -> Result<TcpStream, Failure> {
        Ok(self.stream.try_clone()?)
    }

    /// Blocks until bytes arrive; returns how many PUBLISH packets they complete, None after 10 s of silence.
    pub fn publishes(&mut self) -> Result<Option<u64>, Failure> {
        self.publishes_each(|_| {})
    }

    /// The same, and shows each of these packets.
    pub fn publishes_each(&mut self, mut show: impl FnMut(&[u8])) -> Result<Option<u64>, Failure> {
        if self.start > 0 {
            self.buffer.copy_within(self.start..self.end, 0);
            self.end -= self.start;
            self.start = 0;
        }
        if self.end == self.buffer.len() {
            self.buffer.resize(2 * self.end, 0);
        }
        match self.stream.read(&mut self.buffer[self.end..]) {
            Ok(0) => return Err("the broker closed the connection".into()),
            Ok(read) => self.end += read,
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                return Ok(None);
            }
            Err(error) => return Err(error.into()),
        }
        let mut count = 0;
        while let Some((kind, length)) = packet::head(&self.buffer[self.start..self.end]) {
            if length > self.end - self.start {
                break;
            }
            if kind == 3 {
                count += 1;
                show(&self.buffer[self.start..self.start + length]);
            }
            self.start += length;
        }
        Ok(Some(count))
    }

    /// Blocks until one PUBLISH more has arrived.
    pub fn await_publish(&mut self) -> Result<(), Failure> {
        loop {
            match self.publishes()? {
                Some(0) => {}
                Some(_) => return Ok(()),
                None => return Err("no message for 10 s: is the topic ours alone?".into()),
            }
        }
    }

    /// How long a read may take before silence is reported.
    pub fn patience(&self, limit: Duration) -> Result<(), Failure> {
        Ok(self.stream.set_read_timeout(Some(limit))?)
    }

    fn await_kind(&mut self, wanted: u8, name: &str) -> Result<(), Failure> {
        let mut bytes = Vec::new();
        loop {
            let mut byte = [0];
            self.stream
                .read_exact(&mut byte)
                .map_err(|error| format!("no {name}: {error}"))?;
            bytes.push(byte[0]);
            let Some((kind, length)) = packet::head(&bytes) else {
                continue;
            };
            if bytes.len() < length {
                continue;
            }
            // CONNACK: flags, reason; SUBACK: identifier, properties, reasons. From 0x80 on a reason is a refusal.
            let reason = if wanted == 2 {
                bytes[3]
            } else {
                bytes[length - 1]
            };
            let refused = reason >= 0x80 || (wanted == 2 && reason != 0);
            return match (kind == wanted, refused) {
                (true, false) => Ok(()),
                _ => Err(format!("{name} expected, the broker answered {bytes:02x?}").into()),
            };
        }
    }
}
