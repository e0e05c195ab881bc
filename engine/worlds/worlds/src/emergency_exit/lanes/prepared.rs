//! What is made of the parameters before the first step. It is kept for the next block, since an evolution evaluates one
//! generation after the other on the same field.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::super::settings::{self, Settings};
use super::MOST_LANES;
use super::exits::{Numbers, packed};
use super::terrain::{Layout, Terrain};
use crate::block::Block;
use crate::{ParameterError, Parameters};

/// More stacks than this in all grids of a group of lanes, and memory rather than arithmetic sets the pace.
const MOST_STACKS: usize = 1 << 25;
/// Up to here something is worth keeping: 4 MB.
const KEPT_BYTES: usize = 1 << 22;

/// Fields, and whatever else all episodes of a block have in common.
pub(crate) struct Prepared {
    pub(super) settings: Settings,
    pub(super) layout: Layout,
    /// `Layout::corrections`
    pub(super) corrections: [i32; 8],
    pub(super) agents: usize,
    /// One for each episode, or one for all.
    pub(super) terrains: Vec<Terrain>,
    /// Of all terrains, one after another.
    pub(super) numbers: Numbers,
    /// By number: the way to an exit from the first cell; terrain after terrain.
    pub(super) exits: Vec<i32>,
    /// By terrain: index in `exits` of its first one.
    pub(super) first_exits: Vec<i32>,
    /// Whether the parameters give the field; else each episode draws its own.
    given: bool,
}

/// What was prepared last, and for what.
struct Kept {
    parameters: Parameters,
    /// Seeds of the fields; empty if the field was given.
    seeds: Vec<u64>,
    prepared: Arc<Prepared>,
}

static LAST: Mutex<Option<Kept>> = Mutex::new(None);

fn last() -> MutexGuard<'static, Option<Kept>> {
    LAST.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Prepared {
    /// Checks the parameters of every episode; `None` if lanes are not worthwhile or not possible.
    pub(super) fn of(block: &Block<'_>) -> Result<Option<Arc<Self>>, ParameterError> {
        if block.seeds.is_empty() {
            return Ok(None);
        }
        let is_fixed = block.parameters.contains_key("field");
        let seeds: &[u64] = if is_fixed { &[] } else { block.seeds };
        if let Some(cached) = &*last()
            && cached.seeds == seeds
            && cached.parameters == *block.parameters
        {
            return Ok(Some(Arc::clone(&cached.prepared)));
        }
        let Some(prepared) = Self::new(block, is_fixed)?.map(Arc::new) else {
            return Ok(None);
        };
        *last() = (prepared.numbers.len() <= KEPT_BYTES).then(|| Kept {
            parameters: block.parameters.clone(),
            seeds: seeds.to_vec(),
            prepared: Arc::clone(&prepared),
        });
        Ok(Some(prepared))
    }

    fn new(block: &Block<'_>, is_fixed: bool) -> Result<Option<Self>, ParameterError> {
        let mut fields = Vec::new();
        let mut settings = None;
        for episode in 0..if is_fixed { 1 } else { block.seeds.len() } {
            let parameters = block.parameters_of(episode);
            if settings.is_none() {
                settings = Some(Settings::read(&parameters)?);
            }
            fields.extend(settings::read_field(&parameters, None)?.map(|(_, field)| field));
        }
        let (Some(settings), Some(field)) = (settings, fields.first()) else {
            return Ok(None);
        };
        let layout = Layout::new(field.width, field.height);
        // Rows below the last one are a case of their own, see `Field::rows`.
        if fields.iter().any(|field| field.rows != field.height)
            || layout.stacks * (MOST_LANES + fields.len()) > MOST_STACKS
        {
            return Ok(None);
        }
        let agents = field.agents.len();
        let most_exits = fields.iter().map(|field| field.exits.len()).max();
        let places = 8 * layout.stacks * fields.len();
        let mut numbers = Numbers::new(most_exits.unwrap_or(0), places);
        let mut terrains = Vec::with_capacity(fields.len());
        let (mut exits, mut first_exits) = (Vec::new(), Vec::new());
        for field in &fields {
            terrains.push(Terrain::new(field, &mut numbers));
            first_exits.push(exits.len() as i32);
            exits.extend(field.exits.iter().map(|cell| packed(*cell)));
        }
        Ok(Some(Self {
            settings,
            layout,
            corrections: layout.corrections(),
            agents,
            terrains,
            numbers,
            exits,
            first_exits,
            given: is_fixed,
        }))
    }

    /// The index of an episode's terrain.
    pub(super) fn terrain_of(&self, episode: usize) -> usize {
        if self.given { 0 } else { episode }
    }

    /// Places of a terrain.
    pub(super) fn places(&self) -> usize {
        8 * self.layout.stacks
    }
}
