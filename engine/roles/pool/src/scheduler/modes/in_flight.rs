//! All work in flight: stepwise episodes by hash, blocks and batches by request number.

use std::collections::{HashMap, VecDeque};
use std::time::{Duration, Instant};

use swarmwright_protocol::{MAX_PAYLOAD, Waiting};

use crate::config::Config;
use crate::scheduler::job::Job;
use crate::scheduler::modes::episode::Episode;
use crate::scheduler::modes::request::Request;
use crate::scheduler::queue::piece::{Piece, Purpose};

/// Number of ended episodes that are remembered.
const REMEMBERED: usize = 256;
/// Longest delay of a message behind one that was published after it on another topic.
const OVERTAKEN: Duration = Duration::from_millis(250);
/// How long a server may be busy for an unnamed tool before another tool is assumed. It names the tool once it has
/// received this tool's control message.
const UNNAMED: Duration = Duration::from_secs(2);
/// Number of bytes at each end of an oversized message that are searched for the hash.
const AROUND: usize = 4096;

/// An episode that has ended for this tool, although its server may still begin it or answer.
struct Ended {
    hash: String,
    server: u64,
    /// Whether its fitness arrived.
    answered: bool,
    /// Whether its server may still be running it.
    open: bool,
    /// Its fitness, if one arrived.
    fitness: Option<f64>,
    /// Whether the same fitness arrived again.
    repeated: bool,
}

/// Meaning of a fitness that arrived for an episode that has ended.
pub(crate) enum LateFitness {
    /// The server sent another value before.
    Other(u64),
    /// The server sent the same value before; with the number of remembered episodes for which it did so.
    Same(u64, usize),
    /// The episode was given up.
    GivenUp,
    /// The episode is unknown.
    Unknown,
}

/// Work that was taken back from a server.
pub(crate) enum Dropped {
    Episode(String, Box<Episode>),
    Request(u64, Box<Request>),
}

pub(crate) struct InFlight {
    episodes: HashMap<String, Episode>,
    requests: HashMap<u64, Request>,
    /// Number of the next request. Numbers are never reused, so a late answer is not mistaken for another one.
    next_request: u64,
    first_request: u64,
    /// Episodes that ended recently, the latest last.
    ended: VecDeque<Ended>,
}

impl InFlight {
    pub fn new(first_request: u64) -> Self {
        Self {
            episodes: HashMap::new(),
            requests: HashMap::new(),
            next_request: first_request,
            first_request,
            ended: VecDeque::new(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.episodes.is_empty() && self.requests.is_empty()
    }

    /// Returns the numbers of episodes and of requests.
    pub fn len(&self) -> (usize, usize) {
        (self.episodes.len(), self.requests.len())
    }

    /// Drops all work in flight. Returns the requests.
    pub fn clear(&mut self) -> HashMap<u64, Request> {
        self.episodes.clear();
        std::mem::take(&mut self.requests)
    }

    /// Returns all jobs: episodes sorted by hash, then requests sorted by number.
    pub fn jobs(&self) -> Vec<Job> {
        let mut hashes: Vec<String> = self.episodes.keys().cloned().collect();
        hashes.sort();
        let mut numbers: Vec<u64> = self.requests.keys().copied().collect();
        numbers.sort_unstable();
        let hashes = hashes.into_iter().map(Job::Episode);
        hashes
            .chain(numbers.into_iter().map(Job::Request))
            .collect()
    }

    /// Returns the jobs whose pieces match `chosen`, each with its server, sorted by server.
    pub fn jobs_of(&self, chosen: impl Fn(&Piece) -> bool) -> Vec<(u64, Job)> {
        let episodes = self
            .episodes
            .iter()
            .filter(|(_, episode)| chosen(&episode.piece));
        let mut jobs: Vec<(u64, Job)> = episodes
            .map(|(hash, episode)| (episode.server, Job::Episode(hash.clone())))
            .collect();
        let requests = self
            .requests
            .iter()
            .filter(|(_, request)| chosen(&request.piece));
        jobs.extend(requests.map(|(number, request)| (request.server, Job::Request(*number))));
        jobs.sort_by_key(|(server, _)| *server);
        jobs
    }

    /// Marks the work of a server as backed up. Returns its pieces, sorted, and a message that it waits for.
    pub fn back_up(&mut self, server: u64, now: Instant) -> (Vec<Piece>, String) {
        let mut pieces = Vec::new();
        let mut words = String::new();
        for run in self.episodes_of(server) {
            run.back_up();
            words = run.waiting_for(now).to_string();
            pieces.push(run.piece.clone());
        }
        for request in self.requests_of(server) {
            request.back_up();
            if words.is_empty() {
                words = request.waiting_for(now).to_string();
            }
            pieces.push(request.piece.clone());
        }
        pieces.sort_by_key(Piece::first);
        (pieces, words)
    }

    /// Takes a job back; `None` if it has ended.
    pub fn drop_job(&mut self, job: Job) -> Option<Dropped> {
        match job {
            Job::Episode(hash) => {
                let episode = self.end_episode(&hash, false)?;
                Some(Dropped::Episode(hash, Box::new(episode)))
            }
            Job::Request(number) => {
                let request = self.requests.remove(&number)?;
                Some(Dropped::Request(number, Box::new(request)))
            }
        }
    }

    /// Returns the piece of a job, and since when its server has been working on it.
    pub fn piece_of(&self, job: &Job) -> Option<(&Piece, Instant)> {
        match job {
            Job::Episode(hash) => {
                let episode = self.episodes.get(hash)?;
                Some((&episode.piece, episode.started))
            }
            Job::Request(number) => {
                let request = self.requests.get(number)?;
                // A batch sends a message every step; a block counts from when the server could begin it.
                let is_batch = request.batch.is_some();
                let since = if is_batch {
                    request.started
                } else {
                    request.heard()
                };
                Some((&request.piece, since))
            }
        }
    }

    /// Describes the message that a job waits for.
    pub fn waiting_for(&self, job: &Job, now: Instant) -> Option<Waiting> {
        match job {
            Job::Episode(hash) => Some(self.episodes.get(hash)?.waiting_for(now)),
            Job::Request(number) => Some(self.requests.get(number)?.waiting_for(now)),
        }
    }

    /// Returns whether all work in flight consists of probes.
    pub fn has_probes_alone(&self) -> bool {
        let episodes = self.episodes.values().map(|episode| &episode.piece);
        let mut all = episodes.chain(self.requests.values().map(|request| &request.piece));
        all.all(|piece| piece.purpose == Purpose::Probe)
    }

    /// Returns whether any server is working on an evaluation.
    pub fn has(&self, evaluation: usize) -> bool {
        let episodes = self.episodes.values().map(|episode| &episode.piece);
        let mut all = episodes.chain(self.requests.values().map(|request| &request.piece));
        all.any(|piece| piece.evaluations.contains(&evaluation))
    }

    /// Returns all work in flight, the longest silent first.
    pub fn waiting(&self, now: Instant) -> Vec<Waiting> {
        let mut episodes: Vec<_> = self.episodes.values().collect();
        episodes.sort_by_key(|episode| (episode.heard(), episode.server));
        let mut requests: Vec<_> = self.requests.iter().collect();
        requests.sort_by_key(|(number, request)| (request.heard(), **number));
        let episodes = episodes.into_iter().map(|episode| episode.waiting_for(now));
        let requests = requests
            .into_iter()
            .map(|(_, request)| request.waiting_for(now));
        let mut all: Vec<Waiting> = episodes.chain(requests).collect();
        all.sort_by(|a, b| b.silent.total_cmp(&a.silent));
        all
    }

    /// Returns the time of the next time-out.
    pub fn next_deadline(&self, config: &Config) -> Option<Instant> {
        let episodes = self
            .episodes
            .values()
            .map(|episode| episode.deadline(config));
        episodes
            .chain(self.requests.values().map(Request::deadline))
            .min()
    }
}

/// Episodes.
impl InFlight {
    pub fn begin_episode(&mut self, hash: String, episode: Episode) {
        self.episodes.insert(hash, episode);
    }

    pub fn episode(&self, hash: &str) -> Option<&Episode> {
        self.episodes.get(hash)
    }

    pub fn episode_mut(&mut self, hash: &str) -> Option<&mut Episode> {
        self.episodes.get_mut(hash)
    }

    pub fn episodes(&self) -> impl Iterator<Item = &Episode> {
        self.episodes.values()
    }

    /// Returns the episodes of a server.
    pub fn episodes_of(&mut self, server: u64) -> impl Iterator<Item = &mut Episode> {
        let episodes = self.episodes.values_mut();
        episodes.filter(move |episode| episode.server == server)
    }

    /// Ends an episode; `answered`: its fitness arrived. Returns `None` if it had already ended.
    pub fn end_episode(&mut self, hash: &str, answered: bool) -> Option<Episode> {
        let episode = self.episodes.remove(hash)?;
        self.remember(hash, episode.server, answered);
        Some(episode)
    }

    /// Remembers an episode that has ended.
    pub fn remember(&mut self, hash: &str, server: u64, answered: bool) {
        self.ended.push_back(Ended {
            hash: hash.to_owned(),
            server,
            answered,
            open: !answered,
            fitness: None,
            repeated: false,
        });
        if answered {
            self.forget_unanswered(server);
        }
        if self.ended.len() > REMEMBERED {
            self.ended.pop_front();
        }
    }

    /// Records the fitness of an episode that has just ended.
    pub fn answered_with(&mut self, hash: &str, fitness: f64) {
        let mut ended = self.ended.iter_mut().rev();
        if let Some(ended) = ended.find(|ended| ended.hash == hash) {
            ended.fitness = Some(fitness);
        }
    }

    /// Classifies a fitness that arrived for an episode that is not in flight.
    pub fn came_again(&mut self, hash: &str, fitness: f64) -> LateFitness {
        let mut ended = self.ended.iter_mut();
        let Some(episode) = ended.find(|ended| ended.hash == hash) else {
            return LateFitness::Unknown;
        };
        if !episode.answered {
            return LateFitness::GivenUp;
        }
        let server = episode.server;
        let is_same = |first: f64| first == fitness || (first.is_nan() && fitness.is_nan());
        if !episode.fitness.is_none_or(is_same) {
            return LateFitness::Other(server);
        }
        episode.repeated = true;
        let repeated = self.ended.iter();
        let repeated = repeated.filter(|ended| ended.server == server && ended.repeated);
        LateFitness::Same(server, repeated.count())
    }

    /// Returns the server of an ended episode, and whether its fitness arrived.
    pub fn ended(&self, hash: &str) -> Option<(u64, bool)> {
        let mut ended = self.ended.iter();
        let episode = ended.find(|ended| ended.hash == hash)?;
        Some((episode.server, episode.answered))
    }

    /// Records that a server is running none of its ended episodes.
    pub fn forget_unanswered(&mut self, server: u64) {
        let ended = self.ended.iter_mut().filter(|ended| ended.server == server);
        ended.for_each(|ended| ended.open = false);
    }

    /// Takes the episodes that have ended for this tool but, as far as is known, not for their servers; each is
    /// returned once.
    pub fn take_unanswered(&mut self) -> Vec<(u64, String)> {
        let ended = self.ended.iter_mut().filter(|ended| ended.open);
        ended
            .map(|ended| {
                ended.open = false;
                (ended.server, ended.hash.clone())
            })
            .collect()
    }

    /// Returns the hash of an episode in flight that occurs in a payload; a large payload is searched only at both
    /// ends.
    pub fn named_in(&self, payload: &[u8]) -> Option<String> {
        let (head, tail) = if payload.len() <= MAX_PAYLOAD {
            (payload, &payload[payload.len()..])
        } else {
            (&payload[..AROUND], &payload[payload.len() - AROUND..])
        };
        let [head, tail] = [head, tail].map(String::from_utf8_lossy);
        let named = |hash: &&String| head.contains(hash.as_str()) || tail.contains(hash.as_str());
        self.episodes.keys().find(named).cloned()
    }

    /// Handles a server that answers a discovery sent after an episode's control message, and so is not running that
    /// episode. Either another tool's control message came first and its episode is already over, or the broker
    /// delivered the two messages in reverse order and signs that the episode has begun arrive in a moment.
    pub fn server_answered(&mut self, id: u64, round: u64, now: Instant) {
        for run in self.episodes_of(id) {
            run.server_answered(round, now + OVERTAKEN);
        }
    }

    /// Handles a server that is busy for this tool, whose name is `own`, or does not name the tool.
    pub fn server_is_busy(&mut self, id: u64, tool: Option<&str>, own: &str, now: Instant) {
        let until = match tool {
            None => Some(now + UNNAMED),
            Some(tool) if tool == own => None,
            Some(_) => return,
        };
        for run in self.episodes_of(id) {
            run.server_is_busy(until);
        }
    }

    /// Returns the episodes that should have begun by now on servers that are free, each with its server.
    pub fn vacant_episodes(&self, now: Instant) -> Vec<(String, u64)> {
        self.over_at(Episode::vacant_until, now)
    }

    /// Returns the episodes that should have begun by now on servers that are busy, each with its server.
    pub fn taken_episodes(&self, now: Instant) -> Vec<(String, u64)> {
        self.over_at(Episode::unnamed_until, now)
    }

    fn over_at(&self, end: fn(&Episode) -> Option<Instant>, now: Instant) -> Vec<(String, u64)> {
        let episodes = self.episodes.iter();
        let over = episodes.filter(|(_, episode)| end(episode).is_some_and(|at| at <= now));
        let mut over: Vec<(String, u64)> = over
            .map(|(hash, episode)| (hash.clone(), episode.server))
            .collect();
        over.sort();
        over
    }

    /// Returns the episodes that have timed out.
    pub fn late_episodes(&self, config: &Config, now: Instant) -> Vec<String> {
        let episodes = self.episodes.iter();
        let late = episodes.filter(|(_, episode)| episode.deadline(config) <= now);
        let mut late: Vec<String> = late.map(|(hash, _)| hash.clone()).collect();
        late.sort();
        late
    }
}

/// Requests.
impl InFlight {
    /// Returns the number of the next request.
    pub fn next_request(&self) -> u64 {
        self.next_request
    }

    /// Returns whether a request with this number was ever sent.
    pub fn was_asked(&self, number: u64) -> bool {
        (self.first_request..self.next_request).contains(&number)
    }

    /// Adds a request. Returns its number.
    pub fn begin_request(&mut self, request: Request) -> u64 {
        let number = self.next_request;
        self.next_request += 1;
        self.requests.insert(number, request);
        number
    }

    pub fn request(&self, number: u64) -> Option<&Request> {
        self.requests.get(&number)
    }

    pub fn request_mut(&mut self, number: u64) -> Option<&mut Request> {
        self.requests.get_mut(&number)
    }

    pub fn requests(&self) -> impl Iterator<Item = &Request> {
        self.requests.values()
    }

    /// Returns the requests of a server.
    pub fn requests_of(&mut self, server: u64) -> impl Iterator<Item = &mut Request> {
        let requests = self.requests.values_mut();
        requests.filter(move |request| request.server == server)
    }

    pub fn is_block(&self, number: u64) -> bool {
        let request = self.requests.get(&number);
        request.is_some_and(|request| request.batch.is_none())
    }

    /// Records that a server is still computing, which extends its lease.
    pub fn is_alive(&mut self, server: u64, now: Instant) {
        for request in self.requests_of(server) {
            request.is_alive(now);
        }
    }

    /// Records that a server has finished its earlier jobs and can begin these.
    pub fn may_begin(&mut self, jobs: &[Job], now: Instant) {
        for job in jobs {
            if let Job::Request(number) = job
                && let Some(request) = self.requests.get_mut(number)
            {
                request.hear(now);
            }
        }
    }

    pub fn take_request(&mut self, number: u64) -> Option<Request> {
        self.requests.remove(&number)
    }

    /// Puts back a request that was taken and continues.
    pub fn put_back_request(&mut self, number: u64, request: Request) {
        self.requests.insert(number, request);
    }

    /// Returns the requests whose lease is over.
    pub fn late_requests(&self, now: Instant) -> Vec<u64> {
        let requests = self.requests.iter();
        let late = requests.filter(|(_, request)| request.deadline() <= now);
        let mut late: Vec<u64> = late.map(|(number, _)| *number).collect();
        late.sort_unstable();
        late
    }
}
