//! The connection to the broker, in a thread of its own: it answers the broker while the master computes.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use swarmwright_mqtt::{Connection, Event, PublishOptions, QoS, Subscription, TooLarge, Waker};
use swarmwright_protocol::{
    BatchSensors, DecodeError, Failed, Fitness, Message, Presence, SensorReading, ServerMessage,
    State, ToTool, Topic, Topics,
};

use super::options::Options;

/// How long the broker may take to read the last messages.
const CLOSING: Duration = Duration::from_secs(1);
/// Interval after which the thread wakes up by itself.
const TURN: Duration = Duration::from_secs(10);
/// Number of bytes of an unreadable message that are searched for the hash.
const AROUND: usize = 4096;

/// What came for this instance.
pub enum News {
    /// A server answers the discovery.
    Answer(Box<ServerMessage>),
    Sensors {
        agent: usize,
        values: Vec<f32>,
    },
    Fitness(Fitness),
    /// The episode failed on the server.
    Failed(Failed),
    Batch(Box<BatchSensors>),
    /// A server left or was lost, with its instance if known.
    Gone(u64, Option<String>),
    /// The connection broke.
    Disconnected(String),
    /// A message of the episode could not be read.
    Unread(String),
    /// A message was not sent.
    Unsent(String),
}

enum Order {
    Publish(String, Vec<u8>),
    Close,
}

/// What is listened to: messages with other hashes are other tools'.
#[derive(Default)]
struct Heard {
    discovery: String,
    episode: String,
    /// By server.
    presences: BTreeMap<u64, Presence>,
}

/// See the module.
pub struct Link {
    pub url: String,
    pub topics: Topics,
    /// The topic for answers, without prefix.
    pub reply: String,
    heard: Arc<Mutex<Heard>>,
    orders: Sender<Order>,
    news: Receiver<News>,
    waker: Waker,
    thread: Option<JoinHandle<()>>,
    broken: bool,
}

impl Link {
    pub fn open(options: &Options) -> Result<Self, String> {
        let topics = Topics::new(&options.prefix)
            .map_err(|error| format!("parameter connection.prefix: {error}"))?;
        let token = format!("{:016x}", fastrand::u64(..));
        let at = |filter, qos| Subscription { filter, qos };
        let subscriptions = vec![
            at(topics.presence_filter(), QoS::AtLeastOnce),
            at(topics.name(Topic::Server), QoS::AtMostOnce),
            at(topics.name(Topic::Sensor), QoS::AtMostOnce),
            at(topics.name(Topic::Fitness), QoS::AtMostOnce),
            at(topics.to_tool(&token), QoS::AtMostOnce),
        ];
        let connection = Connection::open(options.settings()?, subscriptions)
            .map_err(|error| error.to_string())?;
        let (orders, ordered) = channel();
        let (tell, news) = channel();
        let heard = Arc::new(Mutex::new(Heard::default()));
        let mut pump = Pump {
            topics: topics.clone(),
            simulation: options.simulation.clone(),
            heard: heard.clone(),
            news: tell,
        };
        let (url, waker) = (connection.url(), connection.waker());
        let thread = thread::Builder::new()
            .name("swarmwright-fmu".to_owned())
            .spawn(move || pump.run(connection, &ordered))
            .map_err(|error| format!("could not start a thread for the connection: {error}"))?;
        Ok(Self {
            url,
            reply: Topics::default().to_tool(&token),
            topics,
            heard,
            orders,
            news,
            waker,
            thread: Some(thread),
            broken: false,
        })
    }

    /// Listens to answers with this hash, and to messages of the episode with that one; what came before is forgotten.
    pub fn listen(&mut self, discovery: &str, episode: &str) {
        let mut heard = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
        heard.discovery = discovery.to_owned();
        heard.episode = episode.to_owned();
        drop(heard);
        while let Ok(news) = self.news.try_recv() {
            self.broken |= matches!(news, News::Disconnected(_));
        }
    }

    /// What servers last said of themselves.
    pub fn presences(&self) -> Vec<Presence> {
        let heard = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
        heard.presences.values().cloned().collect()
    }

    pub fn publish(&self, topic: String, payload: Vec<u8>) {
        if self.orders.send(Order::Publish(topic, payload)).is_ok() {
            self.waker.wake();
        }
    }

    /// The next news; none when the time has come.
    pub fn next(&mut self, until: Instant) -> Option<News> {
        let wait = until.saturating_duration_since(Instant::now());
        let news = match self.news.recv_timeout(wait) {
            Ok(news) => news,
            Err(RecvTimeoutError::Timeout) => return None,
            Err(RecvTimeoutError::Disconnected) => {
                News::Disconnected("its thread has ended; see the printed output".to_owned())
            }
        };
        self.broken |= matches!(news, News::Disconnected(_));
        Some(news)
    }

    /// Whether the connection has never been lost.
    pub fn is_usable(&mut self) -> bool {
        while let Ok(news) = self.news.try_recv() {
            self.broken |= matches!(news, News::Disconnected(_));
        }
        !self.broken
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        let _ = self.orders.send(Order::Close);
        self.waker.wake();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// The thread's side.
struct Pump {
    topics: Topics,
    simulation: String,
    heard: Arc<Mutex<Heard>>,
    news: Sender<News>,
}

impl Pump {
    fn run(&mut self, mut connection: Connection, orders: &Receiver<Order>) {
        let mut events = Vec::new();
        loop {
            while let Ok(order) = orders.try_recv() {
                match order {
                    Order::Publish(topic, payload) => {
                        self.publish(&mut connection, &topic, &payload);
                    }
                    Order::Close => return connection.close(CLOSING),
                }
            }
            connection.poll(Instant::now() + TURN, &mut events);
            for event in events.drain(..) {
                self.event(event);
            }
        }
    }

    fn publish(&self, connection: &mut Connection, topic: &str, payload: &[u8]) {
        let options = PublishOptions {
            // A server would take a second copy for the next step.
            confirm: topic != self.topics.name(Topic::Actuator),
            ..PublishOptions::default()
        };
        if let Err(TooLarge { bytes, most }) = connection.publish_with(topic, payload, &options) {
            self.tell(News::Unsent(format!(
                "{topic}: a message of {bytes} bytes is larger than the {most} that the broker at {} accepts",
                connection.url()
            )));
        }
    }

    fn tell(&self, news: News) {
        // The receiver is there as long as the instance is.
        let _ = self.news.send(news);
    }

    fn event(&mut self, event: Event) {
        match event {
            Event::Connected => {}
            Event::Disconnected { reason, .. } => self.tell(News::Disconnected(reason)),
            Event::Denied { message, .. } => self.tell(News::Unsent(message)),
            Event::Message(message) => {
                let Some(topic) = self.topics.parse(message.topic()) else {
                    return;
                };
                if topic == Topic::Presence {
                    let last = message.topic().rsplit('/').next().unwrap_or_default();
                    self.presence(last, message.payload(), message.retained());
                } else if !message.retained() {
                    self.message(topic, message.payload());
                }
            }
        }
    }

    fn presence(&mut self, id: &str, payload: &[u8], retained: bool) {
        let mut heard = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
        if payload.is_empty() {
            if let Ok(id) = id.parse() {
                heard.presences.remove(&id);
                drop(heard);
                self.tell(News::Gone(id, None));
            }
        } else if let Ok(Message::Presence(presence)) = Message::decode(Topic::Presence, payload) {
            let id = presence.server;
            if presence.state == State::Lost {
                heard.presences.remove(&id);
                drop(heard);
                // One that is kept by the broker is of an earlier start.
                if !retained {
                    let announced = presence.capabilities.swarmwright;
                    self.tell(News::Gone(
                        id,
                        announced.and_then(|capabilities| capabilities.instance),
                    ));
                }
            } else {
                heard.presences.insert(id, presence);
            }
        }
    }

    fn message(&self, topic: Topic, payload: &[u8]) {
        let (discovery, episode) = {
            let heard = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
            (heard.discovery.clone(), heard.episode.clone())
        };
        let is_ours = |simulation: Option<&str>, hash: &str| {
            hash == episode && simulation.is_none_or(|title| title == self.simulation)
        };
        let unread = |error: &DecodeError| {
            let end = payload.len().min(AROUND);
            if !episode.is_empty() && String::from_utf8_lossy(&payload[..end]).contains(&episode) {
                self.tell(News::Unread(format!("{} message: {error}", topic.name())));
            }
        };
        match topic {
            Topic::Server => {
                if let Ok(Message::Server(answer)) = Message::decode(topic, payload)
                    && answer.simulation_hash == discovery
                {
                    self.tell(News::Answer(Box::new(answer)));
                }
            }
            Topic::Sensor => match SensorReading::decode(payload) {
                Ok(reading) if is_ours(reading.simulation.as_deref(), &reading.simulation_hash) => {
                    let agent = usize::try_from(reading.agent).unwrap_or(usize::MAX);
                    let values = reading.sensor;
                    self.tell(News::Sensors { agent, values });
                }
                Ok(_) => {}
                Err(error) => unread(&error),
            },
            Topic::Fitness => match Message::decode(topic, payload) {
                Ok(Message::Fitness(fitness))
                    if is_ours(fitness.simulation.as_deref(), &fitness.simulation_hash) =>
                {
                    self.tell(News::Fitness(fitness));
                }
                Ok(_) => {}
                Err(error) => unread(&error),
            },
            // This topic is the instance's own.
            Topic::ToTool => match ToTool::decode(payload) {
                Ok(ToTool::Sensors(batch)) => self.tell(News::Batch(Box::new(batch))),
                Ok(ToTool::Failed(failed)) if failed.simulation_hash == episode => {
                    self.tell(News::Failed(failed));
                }
                Ok(_) => {}
                Err(error) => {
                    self.tell(News::Unread(format!("a server's message: {error}")));
                }
            },
            _ => {}
        }
    }
}
