//! The contents of a message: one description for people and for programs.

use std::fmt::{self, Display, Formatter};

use serde_json::{Map, Value, json};

use super::printable::escaped;

/// One fact in a message, for example the joint positions.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Fact {
    /// The name in text, for example `joints`.
    pub name: String,
    /// In words that a terminal may show, such as `+45.00° -10.00°`.
    pub text: String,
    /// The values: one, or one for each joint.
    pub items: Vec<Item>,
}

/// One value of a fact.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Item {
    /// The name in JSON, with its unit, for example `joint_1_deg`.
    pub key: String,
    /// Null without a measured value.
    pub value: Value,
    /// The name in text, for example `joint 1`.
    pub name: String,
    /// In words.
    pub text: String,
}

impl Fact {
    /// A value with a unit of its own in its key.
    pub fn new(name: &str, key: &str, value: impl Into<Value>, text: impl Display) -> Self {
        Self::of(name, text, [(key, value.into())])
    }

    /// Words, whose key is the name.
    pub fn words(name: &str, text: impl Display) -> Self {
        let text = text.to_string();
        Self::new(name, &name.replace([' ', '-'], "_"), text.as_str(), &text)
    }

    /// A fact of several values with one text.
    pub fn of<'a>(name: &str, text: impl Display, values: impl IntoIterator<Item = (&'a str, Value)>) -> Self {
        let (name, text) = (name.to_owned(), escaped(&text.to_string()));
        let items = values.into_iter().map(|(key, value)| Item {
            key: key.to_owned(),
            value,
            name: name.clone(),
            text: text.clone(),
        });
        let items = items.collect();
        Self { name, text, items }
    }

    /// True for several values with one text.
    pub fn has_one_text(&self) -> bool {
        self.items.len() > 1 && self.items.iter().all(|item| item.name == self.name)
    }

    /// The values of joints or servos from number 1, each with its words: `one` is such as `joint`, and `unit` is that of
    /// the values, while `shown` is that of the words.
    pub fn each(
        (name, one): (&str, &str),
        unit: &str,
        shown: &str,
        values: impl IntoIterator<Item = (Value, String)>,
    ) -> Self {
        let values = (1..).zip(values);
        let items: Vec<_> = values
            .map(|(n, (value, text))| Item {
                key: format!("{one}_{n}_{unit}"),
                value,
                name: format!("{one} {n}"),
                text,
            })
            .collect();
        let texts: Vec<_> = items.iter().map(|item| item.text.as_str()).collect();
        let text = texts.join(" ") + shown;
        let name = name.to_owned();
        Self { name, text, items }
    }
}

/// The name and the words, as in the text of a message.
impl Display for Fact {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match (self.name.as_str(), self.text.as_str()) {
            (name, "") => f.write_str(name),
            (name, text) => write!(f, "{name}: {text}"),
        }
    }
}

/// A number for programs. Six decimals are below the resolution of every arm. NaN is null.
pub fn number(value: f64) -> Value {
    json!((value * 1e6).round() / 1e6)
}

/// Facts on one line, as in the text of a message.
pub fn line(facts: &[Fact]) -> String {
    let facts: Vec<_> = facts.iter().map(Fact::to_string).collect();
    facts.join(", ")
}

/// Facts as a JSON object.
pub fn object(facts: &[Fact]) -> Map<String, Value> {
    let items = facts.iter().flat_map(|fact| &fact.items);
    items.map(|item| (item.key.clone(), item.value.clone())).collect()
}
