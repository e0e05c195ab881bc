//! A client for the tests: raw MQTT over any stream, encoded without the broker's own code.

#![allow(
    dead_code,
    clippy::unwrap_used,
    clippy::panic,
    clippy::expect_used,
    reason = "a test; each uses a part of it"
)]

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;
use swarmwright_broker::{Broker, Config};

pub const CONNACK: u8 = 0x20;
pub const PUBLISH: u8 = 0x30;
pub const SUBACK: u8 = 0x90;
pub const DISCONNECT: u8 = 0xe0;

/// Fails a test that takes longer than a minute.
pub fn in_time(test: impl FnOnce() + Send + 'static) {
    let (done, is_done) = mpsc::channel();
    let running = thread::spawn(move || {
        test();
        let _ = done.send(());
    });
    if is_done.recv_timeout(Duration::from_secs(60)) == Err(mpsc::RecvTimeoutError::Timeout) {
        panic!("not done within a minute");
    }
    if let Err(failure) = running.join() {
        std::panic::resume_unwind(failure);
    }
}

pub fn broker() -> Broker {
    Broker::start(&Config::default()).unwrap()
}

pub fn text(text: &str) -> Vec<u8> {
    let mut bytes = (text.len() as u16).to_be_bytes().to_vec();
    bytes.extend(text.as_bytes());
    bytes
}

pub fn packet(first: u8, body: &[u8]) -> Vec<u8> {
    let mut bytes = vec![first];
    let mut length = body.len();
    while length > 0x7f {
        bytes.push((length & 0x7f) as u8 | 0x80);
        length >>= 7;
    }
    bytes.push(length as u8);
    bytes.extend(body);
    bytes
}

/// Fields of a CONNECT.
pub struct Hello<'a> {
    pub version: u8,
    pub id: &'a str,
    pub user: Option<(&'a str, &'a str)>,
    /// Topic and payload, retained.
    pub will: Option<(&'a str, &'a str)>,
}

impl Default for Hello<'_> {
    fn default() -> Self {
        Self {
            version: 5,
            id: "",
            user: None,
            will: None,
        }
    }
}

impl Hello<'_> {
    pub fn bytes(&self) -> Vec<u8> {
        let mut body = text("MQTT");
        let will = if self.will.is_some() { 0x24 } else { 0 };
        let user = if self.user.is_some() { 0xc0 } else { 0 };
        body.extend([self.version, 2 | will | user, 0, 0]);
        let five = self.version == 5;
        body.extend(five.then_some(0));
        body.extend(text(self.id));
        if let Some((topic, payload)) = self.will {
            body.extend(five.then_some(0));
            body.extend(text(topic));
            body.extend(text(payload));
        }
        if let Some((user, password)) = self.user {
            body.extend(text(user));
            body.extend(text(password));
        }
        packet(0x10, &body)
    }
}

/// A client on any stream.
pub struct Client<S> {
    pub stream: S,
    five: bool,
    buffer: Vec<u8>,
}

impl Client<TcpStream> {
    /// Connects, and checks that the client is accepted.
    pub fn join(broker: &Broker, hello: &Hello<'_>) -> Self {
        let (client, code) = Self::knock(broker, hello);
        assert_eq!(code, 0, "CONNACK");
        client
    }

    /// Connects, and returns the code of the CONNACK as well.
    pub fn knock(broker: &Broker, hello: &Hello<'_>) -> (Self, u8) {
        let stream = TcpStream::connect(("127.0.0.1", broker.port())).unwrap();
        stream.set_nodelay(true).unwrap();
        stream
            .set_read_timeout(Some(Duration::from_secs(20)))
            .unwrap();
        let mut client = Client::over(stream, hello);
        let code = client.expect(CONNACK)[1];
        (client, code)
    }
}

impl<S: Read + Write> Client<S> {
    /// Sends CONNECT on an open stream.
    pub fn over(stream: S, hello: &Hello<'_>) -> Self {
        let mut client = Self::new(stream, hello.version == 5);
        client.send(&hello.bytes());
        client
    }

    /// Creates a client that has sent nothing yet.
    pub fn new(stream: S, five: bool) -> Self {
        Self {
            stream,
            five,
            buffer: Vec::new(),
        }
    }

    pub fn send(&mut self, bytes: &[u8]) {
        self.stream.write_all(bytes).unwrap();
        self.stream.flush().unwrap();
    }

    pub fn subscribe(&mut self, filter: &str, qos: u8) {
        let mut body = vec![0, 1];
        body.extend(self.five.then_some(0));
        body.extend(text(filter));
        body.push(qos);
        self.send(&packet(0x82, &body));
        let answer = self.expect(SUBACK);
        assert_eq!(answer.last(), Some(&qos), "SUBACK");
    }

    /// Encodes a PUBLISH of QoS 0; `properties` are for MQTT 5 only.
    pub fn message(&self, topic: &str, retain: bool, properties: &[u8], payload: &[u8]) -> Vec<u8> {
        let mut body = text(topic);
        if self.five {
            body.push(properties.len() as u8);
            body.extend(properties);
        }
        body.extend(payload);
        packet(PUBLISH | u8::from(retain), &body)
    }

    pub fn publish(&mut self, topic: &str, retain: bool, payload: &[u8]) {
        let message = self.message(topic, retain, &[], payload);
        self.send(&message);
    }

    /// Returns the next packet, or `None` if the broker has ended the connection.
    pub fn next(&mut self) -> Option<(u8, Vec<u8>)> {
        loop {
            if let Some((head, length)) = head(&self.buffer)
                && self.buffer.len() >= head + length
            {
                let rest = self.buffer.split_off(head + length);
                let packet = std::mem::replace(&mut self.buffer, rest);
                return Some((packet[0], packet[head..].to_vec()));
            }
            let mut chunk = [0; 4096];
            match self.stream.read(&mut chunk) {
                Ok(0) => return None,
                Ok(count) => self.buffer.extend(&chunk[..count]),
                Err(error) if error.kind() == ErrorKind::ConnectionReset => return None,
                Err(error) => panic!("waiting for a packet: {error}"),
            }
        }
    }

    pub fn expect(&mut self, expected: u8) -> Vec<u8> {
        match self.next() {
            Some((first, body)) if first == expected => body,
            other => panic!("{expected:#x} expected, {other:02x?} came"),
        }
    }

    /// Returns retain flag, topic, properties and payload of the next packet, which must be a message.
    pub fn hear(&mut self) -> (bool, String, Vec<u8>, Vec<u8>) {
        let Some((first, body)) = self.next() else {
            panic!("the broker ended the connection")
        };
        assert_eq!(first & 0xf0, PUBLISH, "{first:#x} came");
        let topic = 2 + usize::from(u16::from_be_bytes([body[0], body[1]]));
        let name = String::from_utf8(body[2..topic].to_vec()).unwrap();
        let properties = if self.five {
            usize::from(body[topic])
        } else {
            0
        };
        let start = topic + usize::from(self.five);
        let payload = body[start + properties..].to_vec();
        (
            first & 1 == 1,
            name,
            body[start..start + properties].to_vec(),
            payload,
        )
    }

    pub fn hear_payload(&mut self) -> String {
        String::from_utf8(self.hear().3).unwrap()
    }
}

/// Returns the lengths of the fixed header and of the body.
fn head(bytes: &[u8]) -> Option<(usize, usize)> {
    let mut length = 0;
    for (index, byte) in bytes.iter().skip(1).take(4).enumerate() {
        length |= usize::from(byte & 0x7f) << (7 * index);
        if byte & 0x80 == 0 {
            return Some((index + 2, length));
        }
    }
    None
}
