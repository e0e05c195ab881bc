//! Selection of survivors and parents, and detection of duplicate children.
#![expect(
    clippy::needless_pass_by_value,
    reason = "pyo3 hands arguments over by value"
)]

use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use swarmwright_evolution::{self as evolution, Ranks, Torus, Way, Ways};

use crate::errors::input;
use crate::evolution::row_major;
use crate::streams::PyStream;

#[pyfunction]
pub fn survivors<'py>(
    py: Python<'py>,
    fitness: PyReadonlyArray1<'py, f64>,
    best: usize,
    random: usize,
    mut stream: PyRefMut<'py, PyStream>,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let members = evolution::survivors(fitness.as_slice()?, best, random, &mut stream.0);
    Ok(indices(py, members))
}

#[pyfunction]
pub fn distinct<'py>(
    py: Python<'py>,
    genomes: PyReadonlyArray2<'py, f32>,
    existing: Vec<PyReadonlyArray2<'py, f32>>,
) -> PyResult<Bound<'py, PyArray1<i64>>> {
    let genes = genomes.shape()[1];
    if genes == 0 || existing.iter().any(|rows| rows.shape()[1] != genes) {
        return Err(input(
            "expected genomes with the same number of genes, at least one",
        ));
    }
    let existing: Vec<_> = existing.iter().map(row_major).collect();
    let existing: Vec<&[f32]> = existing.iter().map(AsRef::as_ref).collect();
    let rows = evolution::distinct(&existing, &row_major(&genomes), genes);
    Ok(indices(py, rows))
}

/// Members that are replaced one by one, in the order of their ranks.
#[pyclass(name = "Ranks", module = "swarmwright._engine")]
pub struct PyRanks(Ranks);

#[pymethods]
impl PyRanks {
    #[new]
    fn new(members: u32) -> PyResult<Self> {
        if members == 0 {
            return Err(input("members: 0 found, expected at least 1"));
        }
        Ok(Self(Ranks::new(members)))
    }

    fn set(&mut self, member: u32, fitness: f64) -> PyResult<()> {
        let members = self.0.members();
        if member as usize >= members {
            return Err(input(format!(
                "member {member} does not exist; there are {members} members"
            )));
        }
        self.0.set(member, fitness);
        Ok(())
    }

    #[getter]
    fn worst(&self) -> Option<usize> {
        self.0.worst()
    }

    #[getter]
    fn worked(&self) -> usize {
        self.0.worked()
    }

    fn draw(&self, mut stream: PyRefMut<'_, PyStream>, count: usize) -> PyResult<Vec<usize>> {
        if self.0.worked() == 0 {
            return Err(input("all members have failed"));
        }
        Ok((0..count).map(|_| self.0.draw(&mut stream.0)).collect())
    }
}

/// Members on a torus, who meet their neighbours only.
#[pyclass(name = "Torus", module = "swarmwright._engine", frozen)]
pub struct PyTorus(Torus);

#[pymethods]
impl PyTorus {
    #[new]
    #[pyo3(signature = (width, height, *, obstacles, random, elite, seed))]
    fn new(
        width: usize,
        height: usize,
        obstacles: usize,
        random: bool,
        elite: f64,
        seed: u64,
    ) -> PyResult<Self> {
        let cells = width.checked_mul(height).filter(|cells| *cells < MOST);
        let Some(members) = cells.and_then(|cells| cells.checked_sub(obstacles)) else {
            return Err(input(
                "expected fewer than 2**32 cells and at most as many obstacles",
            ));
        };
        if members == 0 {
            return Err(input(
                "obstacles: must leave at least one cell for a member",
            ));
        }
        Ok(Self(if random {
            Torus::random(members, seed, elite)
        } else {
            Torus::grid(width, height, obstacles, seed, elite)
        }))
    }

    fn neighbours(&self, member: usize) -> PyResult<Vec<u32>> {
        self.member(member)?;
        Ok(self.0.neighbours(member).to_vec())
    }

    fn elite(&self, fitness: PyReadonlyArray1<'_, f64>, member: usize) -> PyResult<Vec<usize>> {
        self.member(member)?;
        Ok(self.0.elite(self.all(&fitness)?, member))
    }

    fn stays(&self, fitness: PyReadonlyArray1<'_, f64>, member: usize) -> PyResult<bool> {
        self.member(member)?;
        Ok(self.0.stays(self.all(&fitness)?, member))
    }

    fn changing<'py>(
        &self,
        py: Python<'py>,
        fitness: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let fitness = self.all(&fitness)?;
        let all = 0..self.0.members();
        let changing = all.filter(|member| !self.0.stays(fitness, *member));
        Ok(indices(py, changing.collect()))
    }

    fn next(&self, fitness: PyReadonlyArray1<'_, f64>, cursor: usize) -> PyResult<Option<usize>> {
        self.member(cursor)?;
        Ok(self.0.next(self.all(&fitness)?, cursor))
    }

    #[pyo3(signature = (fitness, cells, drawn, *, mutate, crossover))]
    fn choose<'py>(
        &self,
        py: Python<'py>,
        fitness: PyReadonlyArray1<'py, f64>,
        cells: PyReadonlyArray1<'py, i64>,
        drawn: PyReadonlyArray2<'py, f64>,
        mutate: f64,
        crossover: f64,
    ) -> PyResult<ParentsAndRows<'py>> {
        let fitness = self.all(&fitness)?;
        if drawn.shape() != [cells.len(), 2] {
            return Err(input("expected two numbers for each cell"));
        }
        let ways = Ways { mutate, crossover };
        let mut parents = Vec::with_capacity(cells.len());
        let mut rows = [Vec::new(), Vec::new(), Vec::new()];
        for (row, (cell, drawn)) in cells.as_slice()?.iter().zip(pairs(&drawn)?).enumerate() {
            let cell = usize::try_from(*cell).unwrap_or(usize::MAX);
            self.member(cell)?;
            let (way, parent) = match self.0.choose(fitness, cell, ways, *drawn) {
                Way::Mutate(parent) => (0, parent),
                Way::Cross(parent) => (1, parent),
                Way::Renew => (2, cell),
            };
            rows[way].push(row);
            parents.push(parent);
        }
        let [mutated, crossed, renewed] = rows.map(|rows| indices(py, rows));
        Ok((indices(py, parents), mutated, crossed, renewed))
    }
}

type Indices<'py> = Bound<'py, PyArray1<i64>>;
type ParentsAndRows<'py> = (Indices<'py>, Indices<'py>, Indices<'py>, Indices<'py>);

/// Cells of a torus at most.
const MOST: usize = u32::MAX as usize;

impl PyTorus {
    fn member(&self, member: usize) -> PyResult<()> {
        let members = self.0.members();
        if member >= members {
            return Err(input(format!(
                "member {member} does not exist; there are {members} members"
            )));
        }
        Ok(())
    }

    fn all<'a>(&self, fitness: &'a PyReadonlyArray1<'_, f64>) -> PyResult<&'a [f64]> {
        let members = self.0.members();
        if fitness.len() != members {
            let count = fitness.len();
            return Err(input(format!(
                "fitness: {count} values for {members} members"
            )));
        }
        Ok(fitness.as_slice()?)
    }
}

fn pairs<'a>(array: &'a PyReadonlyArray2<'_, f64>) -> PyResult<&'a [[f64; 2]]> {
    Ok(array.as_slice()?.as_chunks().0)
}

fn indices(py: Python<'_>, indices: Vec<usize>) -> Indices<'_> {
    let indices: Vec<i64> = indices.into_iter().map(|index| index as i64).collect();
    indices.into_pyarray(py)
}
