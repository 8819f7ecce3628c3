//! Rules of which boxes may meet: tags by index, filters, lists of pairs.

use std::sync::Arc;

use pairmask::filters::{Filter, FilterId, FilterTable, Owner, Rules, Tag, World};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{integers, pairs};

/// What boxes of a kind meet.
#[pyclass(frozen, eq, from_py_object, name = "Filter", module = "pairmask")]
#[derive(Clone, Copy, PartialEq)]
pub struct PyFilter {
    pub filter: Filter,
}

#[pymethods]
impl PyFilter {
    #[new]
    #[pyo3(signature = (category=u64::MAX, mask=u64::MAX, *, group=0, is_static=false, either=false))]
    fn new(category: u64, mask: u64, group: i32, is_static: bool, either: bool) -> Self {
        let filter = Filter::new(category, mask).with_group(group);
        Self { filter: filter.with_static(is_static).with_either(either) }
    }

    /// What it is: a bit a category.
    #[getter]
    fn category(&self) -> u64 {
        self.filter.category
    }

    /// What it meets: a bit a category.
    #[getter]
    fn mask(&self) -> u64 {
        self.filter.mask
    }

    /// Equal groups other than 0 decide by their sign.
    #[getter]
    fn group(&self) -> i32 {
        self.filter.group
    }

    /// Whether boxes of this kind are static.
    #[getter]
    fn is_static(&self) -> bool {
        self.filter.is_static
    }

    /// Whether one mask of two is enough.
    #[getter]
    fn either(&self) -> bool {
        self.filter.either
    }

    /// Whether boxes of the two kinds meet, as far as these say.
    fn admits(&self, other: &Self) -> bool {
        self.filter.admits(&other.filter)
    }

    fn __repr__(&self) -> String {
        format!("{:?}", self.filter)
    }
}

/// The filters of a scene or of a frame's rules, by the numbers that tags name.
#[pyclass(frozen, name = "FilterTable", module = "pairmask")]
pub struct PyFilterTable {
    table: Arc<FilterTable>,
}

impl PyFilterTable {
    pub fn shared(&self) -> Arc<FilterTable> {
        Arc::clone(&self.table)
    }
}

#[pymethods]
impl PyFilterTable {
    #[new]
    fn new(filters: Vec<PyFilter>) -> PyResult<Self> {
        let filters: Vec<Filter> = filters.iter().map(|of| of.filter).collect();
        let table = FilterTable::new(&filters);
        let table = table.map_err(|error| PyValueError::new_err(error.to_string()))?;
        Ok(Self { table: Arc::new(table) })
    }

    fn __len__(&self) -> usize {
        self.table.filters().len()
    }

    fn __getitem__(&self, id: u16) -> PyResult<PyFilter> {
        let filter = self.table.filters().get(usize::from(id));
        let none = || pyo3::exceptions::PyIndexError::new_err("no filter of that number");
        filter.map(|filter| PyFilter { filter: *filter }).ok_or_else(none)
    }

    /// Whether boxes of two filters meet.
    fn meet(&self, a: u16, b: u16) -> bool {
        self.table.meet(FilterId(a), FilterId(b))
    }
}

/// A part of tags: nothing, a number for all, or an array with a number for each.
pub type Part<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

/// Writes a part of tags. `None` leaves it as it is.
fn write_part<T>(
    part: Part<'_, '_>,
    name: &str,
    numpy_type: &'static str,
    tags: &mut [Tag],
    write: impl Fn(&mut Tag, T),
) -> PyResult<()>
where
    T: pyo3::buffer::Element + Default,
{
    let Some(part) = part else { return Ok(()) };
    let numbers: Vec<T> = integers(part, numpy_type)?;
    match numbers[..] {
        // A plain number is an array of one.
        [one] if !part.hasattr("__len__")? => tags.iter_mut().for_each(|tag| write(tag, one)),
        _ if numbers.len() == tags.len() => {
            tags.iter_mut().zip(numbers).for_each(|(tag, number)| write(tag, number));
        }
        _ => {
            let text =
                format!("{} {name} for {} boxes: give one for each", numbers.len(), tags.len());
            return Err(PyValueError::new_err(text));
        }
    }
    Ok(())
}

/// The parts of tags, as Python gives them.
pub struct TagParts<'a, 'py> {
    pub world: Part<'a, 'py>,
    pub owner: Part<'a, 'py>,
    pub filter: Part<'a, 'py>,
    pub is_static: Part<'a, 'py>,
}

impl TagParts<'_, '_> {
    /// Tags of so many boxes. What is not given is that of a box without a tag.
    pub fn tags(&self, count: usize) -> PyResult<Vec<Tag>> {
        let mut tags = vec![Tag::default(); count];
        write_part(self.world, "worlds", "int32", &mut tags, |tag, world: i32| {
            tag.world = World(world);
        })?;
        write_part(self.owner, "owners", "uint32", &mut tags, |tag, owner: u32| {
            tag.owner = Owner(owner);
        })?;
        write_part(self.filter, "filters", "uint16", &mut tags, |tag, filter: u16| {
            tag.filter = FilterId(filter);
        })?;
        write_part(self.is_static, "static flags", "uint8", &mut tags, |tag, flag: u8| {
            *tag = tag.with_static(flag != 0);
        })?;
        Ok(tags)
    }

    /// The number of boxes that the arrays among the parts are for; `None` where there is no array.
    fn len(&self) -> PyResult<Option<usize>> {
        let parts = [self.world, self.owner, self.filter, self.is_static];
        let mut len = None;
        for part in parts.into_iter().flatten() {
            if part.hasattr("__len__")? {
                len = Some(part.len()?);
                break;
            }
        }
        Ok(len)
    }

    /// Whether none is given.
    pub fn are_none(&self) -> bool {
        [self.world, self.owner, self.filter, self.is_static].iter().all(Option::is_none)
    }
}

/// The rules of a frame. They never change: other rules are another object.
#[pyclass(frozen, name = "Rules", module = "pairmask")]
pub struct PyRules {
    rules: Arc<Rules>,
}

impl PyRules {
    pub fn shared(&self) -> Arc<Rules> {
        Arc::clone(&self.rules)
    }
}

#[pymethods]
impl PyRules {
    #[new]
    #[pyo3(signature = (*, worlds=None, owners=None, filters=None, is_static=None, table=None, include=None, exclude=None))]
    #[allow(clippy::too_many_arguments)] // Python has them by name.
    fn new(
        worlds: Part<'_, '_>,
        owners: Part<'_, '_>,
        filters: Part<'_, '_>,
        is_static: Part<'_, '_>,
        table: Option<&PyFilterTable>,
        include: Option<&Bound<'_, PyAny>>,
        exclude: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let parts = TagParts { world: worlds, owner: owners, filter: filters, is_static };
        let len = parts.len()?;
        if len.is_none() && !parts.are_none() {
            let text = "no part of the tags is an array: give one with a number for each box";
            return Err(PyValueError::new_err(text));
        }
        let mut rules = Rules::default();
        rules.tags = parts.tags(len.unwrap_or_default())?;
        if let Some(table) = table {
            rules.table = (*table.table).clone();
        }
        for pair in include.map(pairs).transpose()?.unwrap_or_default() {
            rules.lists.include(pair, true);
        }
        for pair in exclude.map(pairs).transpose()?.unwrap_or_default() {
            rules.lists.exclude(pair, true);
        }
        Ok(Self { rules: Arc::new(rules) })
    }

    /// Boxes that have a tag.
    fn __len__(&self) -> usize {
        self.rules.tags.len()
    }

    /// Whether the boxes of two indices may be a pair.
    fn meet(&self, a: u32, b: u32) -> bool {
        self.rules.meet(a, b)
    }
}
