//! A table of a TOML file, read key by key, so that every fault names its line and its key.
//!
//! Of tables whose `type` says what may be in them, serde knows where they begin and no more.

use std::collections::BTreeSet;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

/// A table that is being read.
pub(crate) struct TomlTable<'a> {
    text: &'a str,
    /// With a dot behind it; nothing of the whole file.
    prefix: &'static str,
    /// Of its beginning.
    line: usize,
    entries: &'a DeTable<'a>,
    asked: BTreeSet<&'static str>,
}

impl<'a> TomlTable<'a> {
    /// The whole of `text`, which `entries` was parsed from.
    pub(crate) fn file(text: &'a str, entries: &'a DeTable<'a>) -> Self {
        Self { text, prefix: "", line: 1, entries, asked: BTreeSet::new() }
    }

    /// The table `key` in this one; `prefix` is what its keys are called by: the key and a dot.
    ///
    /// # Errors
    /// It is not there, or no table.
    pub(crate) fn table(&mut self, key: &'static str, prefix: &'static str) -> Result<Self, String> {
        let value = self.value(key).ok_or_else(|| self.missing(key))?;
        let line = line_at(self.text, value.span().start);
        let entries = value.get_ref().as_table().ok_or_else(|| {
            format!(
                "line {line}: {}{key} is of type {}, not a table",
                self.prefix,
                value.get_ref().type_str()
            )
        })?;
        Ok(Self { text: self.text, prefix, line, entries, asked: BTreeSet::new() })
    }

    /// What stands at `key`.
    ///
    /// # Errors
    /// It is not there, or no `T`.
    pub(crate) fn read<T: serde::de::DeserializeOwned>(&mut self, key: &'static str) -> Result<T, String> {
        let value = self.value(key).ok_or_else(|| self.missing(key))?;
        T::deserialize(ValueDeserializer::from(value.clone())).map_err(|error| {
            let line = line_at(self.text, value.span().start);
            format!("line {line}: {}{key}: {}", self.prefix, error.message())
        })
    }

    /// The `N` numbers that stand at `key`: serde takes the first of a longer list.
    ///
    /// # Errors
    /// They are not there, no numbers, or more or fewer.
    pub(crate) fn read_array<const N: usize>(&mut self, key: &'static str) -> Result<[f32; N], String> {
        let numbers: Vec<f32> = self.read(key)?;
        let found = numbers.len();
        numbers.try_into().map_err(|_numbers| self.fault(key, &format!("has {found} numbers, not {N}")))
    }

    /// What [`Self::read`] reads, or `default` where nothing stands there.
    ///
    /// # Errors
    /// It is no `T`.
    pub(crate) fn read_or<T>(&mut self, key: &'static str, default: T) -> Result<T, String>
    where
        T: serde::de::DeserializeOwned,
    {
        if self.value(key).is_some() { self.read(key) } else { Ok(default) }
    }

    /// A fault of what stands at `key`, with its line; the table's own where nothing does.
    pub(crate) fn fault(&self, key: &str, cause: &str) -> String {
        let line = self.line_of(key).unwrap_or(self.line);
        format!("line {line}: {}{key} {cause}", self.prefix)
    }

    /// The line that `key` stands in.
    pub(crate) fn line_of(&self, key: &str) -> Option<usize> {
        let (found, _) = self.entries.iter().find(|(found, _)| found.get_ref() == key)?;
        Some(line_at(self.text, found.span().start))
    }

    /// Refuses keys that nobody has asked for.
    ///
    /// # Errors
    /// The first of them, and what there may be.
    pub(crate) fn finish(self) -> Result<(), String> {
        let stray = self.entries.keys().find(|key| !self.asked.contains(key.get_ref().as_ref()));
        let Some(key) = stray else { return Ok(()) };
        let known: Vec<&str> = self.asked.iter().copied().collect();
        let line = line_at(self.text, key.span().start);
        let key = key.get_ref();
        Err(format!(
            "line {line}: {}{key} means nothing here; there may be {}",
            self.prefix,
            known.join(", ")
        ))
    }

    fn value(&mut self, key: &'static str) -> Option<&'a Spanned<DeValue<'a>>> {
        self.asked.insert(key);
        self.entries.iter().find(|(found, _)| found.get_ref() == key).map(|(_, value)| value)
    }

    fn missing(&self, key: &str) -> String {
        format!("line {}: {}{key} is missing", self.line, self.prefix)
    }
}

/// The line of `text` that byte `start` is in; the first is 1.
fn line_at(text: &str, start: usize) -> usize {
    1 + text.as_bytes()[..start.min(text.len())].iter().filter(|&&byte| byte == b'\n').count()
}
