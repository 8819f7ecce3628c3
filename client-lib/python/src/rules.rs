//! Rules of which boxes may meet: filter data by index, filters, lists of pairs.

use std::sync::Arc;

use pairmask::filters::{Filter, FilterData, FilterId, FilterTable, Owner, Rules, World};
use pyo3::buffer::PyBuffer;
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;

use crate::arrays::Pairs;
use crate::errors::invalid;

/// What boxes of a kind meet.
#[pyclass(frozen, eq, get_all, from_py_object, name = "Filter", module = "pairmask")]
#[derive(Clone, Copy, PartialEq)]
pub struct PyFilter {
    /// What it is: a bit a category.
    category: u64,
    /// What it meets: a bit a category.
    mask: u64,
    /// Equal groups other than 0 decide by their sign.
    group: i32,
    /// Whether boxes of this kind are static.
    is_static: bool,
    /// Whether one mask of two is enough.
    either: bool,
}

impl From<Filter> for PyFilter {
    fn from(filter: Filter) -> Self {
        let Filter { category, mask, group, is_static, either, .. } = filter;
        Self { category, mask, group, is_static, either }
    }
}

impl PyFilter {
    const fn filter(&self) -> Filter {
        let filter = Filter::new(self.category, self.mask).with_group(self.group);
        filter.with_static(self.is_static).with_either(self.either)
    }
}

#[pymethods]
impl PyFilter {
    #[new]
    #[pyo3(signature = (category=u64::MAX, mask=u64::MAX, *, group=0, is_static=false, either=false))]
    const fn new(category: u64, mask: u64, group: i32, is_static: bool, either: bool) -> Self {
        Self { category, mask, group, is_static, either }
    }

    /// Whether boxes of the two kinds meet, as far as these decide.
    fn admits(&self, other: &Self) -> bool {
        self.filter().admits(&other.filter())
    }

    fn __repr__(&self) -> String {
        format!("{:?}", self.filter())
    }
}

/// The filters of a scene or of a frame's rules, by the numbers that filter data names.
#[pyclass(frozen, name = "FilterTable", module = "pairmask")]
pub struct PyFilterTable(pub Arc<FilterTable>);

#[pymethods]
impl PyFilterTable {
    #[new]
    fn new(filters: Vec<PyFilter>) -> PyResult<Self> {
        let filters: Vec<Filter> = filters.iter().map(PyFilter::filter).collect();
        FilterTable::new(&filters).map(|table| Self(Arc::new(table))).map_err(invalid)
    }

    fn __len__(&self) -> usize {
        self.0.filters().len()
    }

    fn __getitem__(&self, id: u16) -> PyResult<PyFilter> {
        let filter = self.0.filters().get(usize::from(id)).copied();
        filter.map(PyFilter::from).ok_or_else(|| PyIndexError::new_err("no filter of that number"))
    }

    /// Whether boxes of two filters meet.
    fn meet(&self, a: u16, b: u16) -> bool {
        self.0.meet(FilterId(a), FilterId(b))
    }
}

/// A part of filter data: nothing, a number for all, or an array (n) with a number for each.
pub type Part<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

/// Worlds, owners, filters and static flags.
type Columns = (PyBuffer<i32>, PyBuffer<u32>, PyBuffer<u16>, PyBuffer<u8>);

/// Filter data of `n` boxes, or of as many as the first array of the parts has; a single one where no part is an array.
/// World, owner, filter and whether it is static are the parts. What is not given is that of a box without filter data.
pub fn filter_data(
    py: Python<'_>,
    n: Option<usize>,
    parts: [Part<'_, '_>; 4],
) -> PyResult<Vec<FilterData>> {
    let columns = imported!(py, "pairmask._convert", "filter_data")?.call1((n, parts))?;
    let (worlds, owners, filters, flags): Columns = columns.extract()?;
    let named = worlds.to_vec(py)?.into_iter().zip(owners.to_vec(py)?);
    let rest = filters.to_vec(py)?.into_iter().zip(flags.to_vec(py)?);
    let filter_data = |((world, owner), (filter, flag))| {
        FilterData::new(World(world), Owner(owner), FilterId(filter)).with_static(flag != 0)
    };
    Ok(named.zip(rest).map(filter_data).collect())
}

/// A table by which boxes without filter data meet as boxes that all have this one, of any number.
fn table_of_one(filter_data: FilterData, table: &FilterTable) -> PyResult<FilterTable> {
    // Boxes of one owner never meet.
    let filter =
        if filter_data.owner == Owner::NONE { table.get(filter_data.filter) } else { Filter::NONE };
    let filter = filter.with_static(filter.is_static || filter_data.is_static());
    FilterTable::new(&[filter]).map_err(invalid)
}

/// The rules of a frame. They never change: other rules are another object.
///
/// Numbers for each box (n) are for frames of n boxes, and numbers for all for frames of any.
#[pyclass(frozen, name = "Rules", module = "pairmask")]
pub struct PyRules(pub Arc<Rules>);

#[pymethods]
impl PyRules {
    #[new]
    #[pyo3(signature = (
        *, worlds=None, owners=None, filters=None, is_static=None, table=None, include=None, exclude=None
    ))]
    fn new(
        py: Python<'_>,
        worlds: Part<'_, '_>,
        owners: Part<'_, '_>,
        filters: Part<'_, '_>,
        is_static: Part<'_, '_>,
        table: Option<&PyFilterTable>,
        include: Option<Pairs>,
        exclude: Option<Pairs>,
    ) -> PyResult<Self> {
        let parts = [worlds, owners, filters, is_static];
        let mut rules = Rules::default();
        if let Some(table) = table {
            rules.table = (*table.0).clone();
        }
        if parts.iter().any(Option::is_some) {
            rules.filter_data = filter_data(py, None, parts)?;
        }
        if let [filter_data] = rules.filter_data[..]
            && !parts.iter().flatten().any(|part| part.len().is_ok())
        {
            rules.filter_data.clear();
            rules.table = table_of_one(filter_data, &rules.table)?;
        }
        for pair in include.into_iter().flat_map(|pairs| pairs.0) {
            rules.lists.include(pair, true);
        }
        for pair in exclude.into_iter().flat_map(|pairs| pairs.0) {
            rules.lists.exclude(pair, true);
        }
        Ok(Self(Arc::new(rules)))
    }

    /// Boxes with filter data of their own.
    fn __len__(&self) -> usize {
        self.0.filter_data.len()
    }

    fn __repr__(&self) -> String {
        format!("<Rules of {} boxes>", self.0.filter_data.len())
    }

    /// Whether the boxes of two indices may be a pair.
    fn meet(&self, a: u32, b: u32) -> bool {
        self.0.meet(a, b)
    }
}
