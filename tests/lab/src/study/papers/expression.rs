//! Expressions over JSON: numbers, `+ - * /`, comparisons, brackets, and look-ups such as
//! `root_times[processor=gpu,count=1000].ms`, the field `ms` of the first row of `root_times` that fits.
//!
//! Operators stand between spaces, since names may have a `-`. A condition is `field=value`, of several values
//! `field=a|b`, or `field<=number`. `name(a, b)` is the expression that was defined under that name, its `@1` and
//! `@2` replaced; `pair_number(a, b)` is this build's number of a pair of 1,000 boxes, counted from 1.

use std::collections::BTreeMap;

use pairmask_core::{BoxCount, PairIndex};
use serde_json::Value;

/// Boxes of `pair_number`: those of the example of Avril et al. 2012, §3.1.
const PAIR_NUMBER_BOXES: u32 = 1_000;

type Apply = fn(f64, f64) -> f64;
type Operator = (&'static str, Apply);

/// By rank, the lowest first. A comparison is 1 where it holds, else 0.
const OPERATORS: [&[Operator]; 3] = [
    &[
        (" <= ", |a, b| f64::from(a <= b)),
        (" >= ", |a, b| f64::from(a >= b)),
        (" < ", |a, b| f64::from(a < b)),
        (" > ", |a, b| f64::from(a > b)),
    ],
    &[(" + ", |a, b| a + b), (" - ", |a, b| a - b)],
    &[(" * ", |a, b| a * b), (" / ", |a, b| a / b)],
];

#[derive(Clone, Copy, Debug)]
pub struct Scope<'a> {
    pub root: &'a Value,
    pub defined: &'a BTreeMap<String, String>,
}

impl Scope<'_> {
    /// The value of an expression; `None` where a figure is missing.
    pub fn value(&self, text: &str) -> Result<Option<f64>, String> {
        let text = text.trim();
        let bad = || format!("'{text}' is no expression");
        // The last operator of the lowest rank comes last.
        if let Some((left, apply, right)) =
            OPERATORS.iter().find_map(|rank| split_at_last(text, rank))
        {
            let both = self.value(left)?.zip(self.value(right)?);
            return Ok(both.map(|(a, b)| apply(a, b)));
        }
        if text.starts_with(|c: char| c.is_ascii_digit() || c == '-') {
            return text.parse().map(Some).map_err(|_| bad());
        }
        let end = text.find(['(', '[']).unwrap_or(text.len());
        let (name, rest) = text.split_at(end);
        if let Some(inner) = rest.strip_prefix('(') {
            let inner = inner.strip_suffix(')').ok_or_else(bad)?;
            if name == "pair_number" {
                let numbers = inner.split(',').filter_map(|number| number.trim().parse().ok());
                let [a, b] = numbers.collect::<Vec<u32>>()[..] else { return Err(bad()) };
                let k = PairIndex::of(BoxCount::new(PAIR_NUMBER_BOXES), a - 1, b - 1);
                return Ok(k.map(|k| k.get() as f64));
            }
            if name.is_empty() {
                return self.value(inner);
            }
            return self.value(&filled_in(self.defined.get(name).ok_or_else(bad)?, inner));
        }
        let is_name = |c: char| c.is_alphanumeric() || ['_', '-', '.'].contains(&c);
        if name.is_empty() || !name.chars().all(is_name) {
            return Err(bad());
        }
        let found = if let Some(inner) = rest.strip_prefix('[') {
            let (conditions, path) = inner.split_once(']').ok_or_else(bad)?;
            rows(self.root, name, conditions).next().and_then(|row| field(row, path))
        } else {
            field(self.root, name)
        };
        Ok(found.and_then(Value::as_f64))
    }
}

/// A text with the arguments of a list in place of `@1`, `@2`.
pub fn filled_in(text: &str, list: &str) -> String {
    let arguments = (1..).zip(list.split(',').map(str::trim));
    arguments
        .fold(text.to_owned(), |text, (at, argument)| text.replace(&format!("@{at}"), argument))
}

/// A text before and behind its last operator of a rank that stands in no bracket.
fn split_at_last<'a>(text: &'a str, rank: &[Operator]) -> Option<(&'a str, Apply, &'a str)> {
    let (mut depth, mut found) = (0, None);
    for (at, c) in text.char_indices() {
        depth += i32::from(['(', '['].contains(&c)) - i32::from([')', ']'].contains(&c));
        let operator = rank.iter().find(|(name, _)| text[at..].starts_with(name));
        if let Some((name, apply)) = operator.filter(|_| depth == 0) {
            found = Some((&text[..at], *apply, &text[at + name.len()..]));
        }
    }
    found
}

/// The rows of a list that fit: `list[conditions]`, or `list` alone.
pub fn select<'v>(root: &'v Value, text: &str) -> Vec<&'v Value> {
    let (path, conditions) = text.split_once('[').unwrap_or((text, ""));
    rows(root, path, conditions.trim_end_matches(']')).collect()
}

fn rows<'v>(root: &'v Value, path: &str, conditions: &str) -> impl Iterator<Item = &'v Value> {
    let fits = |row: &Value, condition: &str| {
        if let Some((name, most)) = condition.split_once("<=") {
            let found = field(row, name).and_then(Value::as_f64);
            return found.zip(most.parse().ok()).is_some_and(|(found, most)| found <= most);
        }
        let Some((name, values)) = condition.split_once('=') else { return condition.is_empty() };
        values.split('|').any(|value| match field(row, name) {
            Some(Value::String(text)) => text == value,
            Some(Value::Number(number)) => number.as_f64() == value.parse().ok(),
            Some(Value::Bool(is_so)) => is_so.to_string() == value,
            _ => false,
        })
    };
    let list = field(root, path).and_then(Value::as_array).into_iter().flatten();
    list.filter(move |row| conditions.split(',').all(|condition| fits(row, condition)))
}

fn field<'v>(root: &'v Value, path: &str) -> Option<&'v Value> {
    path.split('.').filter(|key| !key.is_empty()).try_fold(root, |value, key| value.get(key))
}
