//! Figures that are kept with the code, so that growth is seen.
//!
//! A file has the compiler that they are of, and a line for each: its name and a number. It is written by a command, never
//! by hand.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use crate::Result;
use crate::toolchain::Toolchain;
use crate::workspace;

/// By how much a figure may grow, in percent.
const TOLERANCE: u64 = 3;

/// What a line with the compiler begins with.
const COMPILER: &str = "compiler ";

/// Figures by name.
pub(crate) type Figures = BTreeMap<String, u64>;

/// Figures, and the compiler that they are of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Baseline {
    compiler: String,
    figures: Figures,
}

impl Baseline {
    /// Figures of what these compilers made.
    ///
    /// # Errors
    ///
    /// If one does not say which it is.
    pub(crate) fn of(figures: Figures, toolchain: Toolchain) -> Result<Self> {
        let compiler = toolchain.version()?;
        Ok(Self { compiler, figures })
    }

    /// Compares with what is in a file of the project, or, if `write`, writes it there. `command` is the one that does.
    ///
    /// What is not measured here, as a tool is missing, is not compared, and stays in the file.
    ///
    /// # Errors
    ///
    /// If figures grew or are new: all of them.
    pub(crate) fn check(mut self, file: &str, command: &str, write: bool) -> Result {
        let path = workspace::root().join(file);
        if write {
            if let Ok(old) = Self::read(&path)
                && old.compiler == self.compiler
            {
                self.keep_unmeasured(old.figures);
            }
            fs::write(&path, self.text(command))?;
            println!("written to {file}");
            return Ok(());
        }
        let kept = Self::read(&path)?;
        if kept.compiler != self.compiler {
            println!(
                "NOT COMPARED: {file} is of {}, this is {}",
                kept.compiler, self.compiler
            );
            return Ok(());
        }
        let grown = self.grown(&kept);
        match grown.is_empty() {
            true => {
                println!(
                    "{} figures, none more than {TOLERANCE} % above {file}",
                    self.figures.len()
                );
                Ok(())
            }
            false => Err(format!(
                "beyond {file}; if that is meant, `{command} --write`:\n{}",
                grown.join("\n")
            )
            .into()),
        }
    }

    /// Takes over all of what nothing was measured now: up to its comma, a name says what it is of.
    fn keep_unmeasured(&mut self, old: Figures) {
        let of = |name: &str| name.split(',').next().map(str::to_owned);
        let measured: BTreeSet<_> = self.figures.keys().map(|name| of(name)).collect();
        self.figures
            .extend(old.into_iter().filter(|(name, _)| !measured.contains(&of(name))));
    }

    /// What is more than it was, or was not there, a line each.
    fn grown(&self, kept: &Self) -> Vec<String> {
        let line = |(name, now): (&String, &u64)| match kept.figures.get(name) {
            Some(was) if now * 100 <= was * (100 + TOLERANCE) => None,
            Some(was) => Some(format!("{name}: {now}, was {was}")),
            None => Some(format!("{name}: {now}, was not there")),
        };
        self.figures.iter().filter_map(line).collect()
    }

    fn read(path: &Path) -> Result<Self> {
        let text = fs::read_to_string(path).map_err(|error| format!("cannot read {}: {error}", path.display()))?;
        Self::parse(&text).ok_or_else(|| format!("{} is not as it was written", path.display()).into())
    }

    fn parse(text: &str) -> Option<Self> {
        let mut lines = text.lines().filter(|line| !line.starts_with('#'));
        let compiler = lines.next()?.strip_prefix(COMPILER)?.to_owned();
        let figure = |line: &str| {
            let (name, number) = line.rsplit_once(' ')?;
            Some((name.to_owned(), number.parse().ok()?))
        };
        let figures = lines.map(figure).collect::<Option<Figures>>()?;
        Some(Self { compiler, figures })
    }

    fn text(&self, command: &str) -> String {
        let figures = self.figures.iter().map(|(name, number)| format!("{name} {number}\n"));
        let figures: String = figures.collect();
        format!(
            "# Written by `{command} --write`.\n{COMPILER}{}\n{figures}",
            self.compiler
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn baseline(figures: &[(&str, u64)]) -> Baseline {
        Baseline {
            compiler: "rustc 1".to_owned(),
            figures: figures
                .iter()
                .map(|(name, number)| ((*name).to_owned(), *number))
                .collect(),
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let kept = baseline(&[("decode", 350), ("a call", 650)]);
        assert_eq!(Baseline::parse(&kept.text("command")), Some(kept));
        assert_eq!(Baseline::parse("decode 350\n"), None, "of which compiler is not said");
        assert_eq!(Baseline::parse("compiler rustc 1\ndecode\n"), None);
    }

    #[test]
    fn what_was_not_measured_is_kept_and_what_is_gone_is_not() {
        let mut new = baseline(&[("m4, decode", 1)]);
        new.keep_unmeasured(baseline(&[("m4, decode", 2), ("m4, gone", 3), ("host, decode", 4)]).figures);
        assert_eq!(new, baseline(&[("m4, decode", 1), ("host, decode", 4)]));
    }

    #[test]
    fn growth_above_three_percent_and_new_figures_are_told() {
        let kept = baseline(&[("decode", 1000), ("gone", 1)]);
        let none: [&str; 0] = [];
        assert_eq!(baseline(&[("decode", 1030)]).grown(&kept), none);
        assert_eq!(baseline(&[("decode", 1031)]).grown(&kept), ["decode: 1031, was 1000"]);
        assert_eq!(baseline(&[("new", 1)]).grown(&kept), ["new: 1, was not there"]);
        assert_eq!(
            baseline(&[("zero", 1)]).grown(&baseline(&[("zero", 0)])),
            ["zero: 1, was 0"]
        );
    }
}
