//! Expressions over JSON: numbers, `+ - * /`, brackets, and look-ups such as
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

/// A text that is no expression.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("'{0}' is no expression")]
pub struct BadExpression(pub String);

/// What names in expressions mean.
#[derive(Clone, Copy, Debug)]
pub struct Scope<'a> {
    /// The object of look-ups.
    pub root: &'a Value,
    /// Expressions by name.
    pub defined: &'a BTreeMap<String, String>,
}

impl Scope<'_> {
    /// The value of an expression; `None` where a figure is missing.
    ///
    /// # Errors
    /// [`BadExpression`].
    pub fn value(&self, text: &str) -> Result<Option<f64>, BadExpression> {
        let mut parser = Parser { scope: self, rest: text };
        match parser.sum() {
            Ok(value) if parser.rest.trim().is_empty() => Ok(value),
            _ => Err(BadExpression(text.to_owned())),
        }
    }
}

/// The rows of a list that fit: `list[conditions]`, or `list` alone.
pub fn select<'v>(root: &'v Value, text: &str) -> Vec<&'v Value> {
    let (path, conditions) = text.split_once('[').unwrap_or((text, ""));
    rows(root, path, conditions.trim_end_matches(']')).collect()
}

fn rows<'v>(root: &'v Value, path: &str, conditions: &str) -> impl Iterator<Item = &'v Value> {
    let list = field(root, path).and_then(Value::as_array);
    list.into_iter().flatten().filter(move |row| {
        conditions.split(',').all(|condition| condition.is_empty() || fits(row, condition))
    })
}

fn fits(row: &Value, condition: &str) -> bool {
    if let Some((name, most)) = condition.split_once("<=") {
        let found = field(row, name).and_then(Value::as_f64);
        return found.zip(most.parse().ok()).is_some_and(|(found, most)| found <= most);
    }
    let Some((name, values)) = condition.split_once('=') else { return false };
    values.split('|').any(|value| match field(row, name) {
        Some(Value::String(text)) => text == value,
        Some(Value::Number(number)) => {
            number.as_f64().zip(value.parse().ok()).is_some_and(|(a, b): (f64, f64)| a == b)
        }
        Some(Value::Bool(is_so)) => is_so.to_string() == value,
        _ => false,
    })
}

/// A field by its path.
pub fn field<'v>(root: &'v Value, path: &str) -> Option<&'v Value> {
    path.split('.').filter(|key| !key.is_empty()).try_fold(root, |value, key| value.get(key))
}

/// The value of a part; `None` where a figure is missing.
type Parsed = Result<Option<f64>, BadExpression>;

/// Recursive descent.
struct Parser<'a> {
    scope: &'a Scope<'a>,
    rest: &'a str,
}

impl<'a> Parser<'a> {
    fn sum(&mut self) -> Parsed {
        let mut sum = self.product()?;
        while let Some(operator) = self.operator(["+ ", "- "]) {
            let other = self.product()?;
            sum = sum.zip(other).map(|(a, b)| if operator == "+ " { a + b } else { a - b });
        }
        Ok(sum)
    }

    fn product(&mut self) -> Parsed {
        let mut product = self.factor()?;
        while let Some(operator) = self.operator(["* ", "/ "]) {
            let other = self.factor()?;
            product = product.zip(other).map(|(a, b)| if operator == "* " { a * b } else { a / b });
        }
        Ok(product)
    }

    fn operator(&mut self, operators: [&'static str; 2]) -> Option<&'static str> {
        let rest = self.rest.trim_start();
        let found = operators.into_iter().find(|operator| rest.starts_with(operator))?;
        self.rest = &rest[found.len()..];
        Some(found)
    }

    fn factor(&mut self) -> Parsed {
        self.rest = self.rest.trim_start();
        if let Some(inner) = self.within('(', ')') {
            return self.scope.value(inner);
        }
        let is_name = |c: char| c.is_alphanumeric() || ['_', '-', '.'].contains(&c);
        let name = self.taken_while(is_name);
        if name.starts_with(|c: char| c.is_ascii_digit()) {
            return name.parse().map(Some).map_err(|_| self.bad());
        }
        if name.is_empty() {
            return Err(self.bad());
        }
        if let Some(arguments) = self.within('(', ')') {
            return self.call(name, arguments);
        }
        let found = if let Some(conditions) = self.within('[', ']') {
            let path = self.taken_while(is_name);
            rows(self.scope.root, name, conditions).next().and_then(|row| field(row, path))
        } else {
            field(self.scope.root, name)
        };
        Ok(found.and_then(Value::as_f64))
    }

    fn call(&self, name: &str, arguments: &str) -> Parsed {
        let arguments: Vec<&str> = arguments.split(',').map(str::trim).collect();
        if name == "pair_number" {
            let numbers: Vec<u32> = arguments.iter().filter_map(|a| a.parse().ok()).collect();
            let [a, b] = numbers[..] else { return Err(self.bad()) };
            let k = PairIndex::of(BoxCount::new(PAIR_NUMBER_BOXES), a - 1, b - 1);
            return Ok(k.map(|k| k.get() as f64));
        }
        let mut text = self.scope.defined.get(name).ok_or_else(|| self.bad())?.clone();
        for (i, argument) in arguments.iter().enumerate() {
            text = text.replace(&format!("@{}", i + 1), argument);
        }
        self.scope.value(&text)
    }

    fn bad(&self) -> BadExpression {
        BadExpression(self.rest.to_owned())
    }

    fn taken_while(&mut self, is_its: impl Fn(char) -> bool) -> &'a str {
        let end = self.rest.find(|c| !is_its(c)).unwrap_or(self.rest.len());
        let (taken, rest) = self.rest.split_at(end);
        self.rest = rest;
        taken
    }

    /// The text within a bracket that the rest begins with.
    fn within(&mut self, open: char, close: char) -> Option<&'a str> {
        let inner = self.rest.strip_prefix(open)?;
        let mut depth = 1;
        let end = inner.find(|c| {
            depth += i32::from(c == open) - i32::from(c == close);
            depth == 0
        })?;
        self.rest = &inner[end + 1..];
        Some(&inner[..end])
    }
}
