//! Shows what the firmware image's instructions or its bytes of code belong to, as `cargo xtask profile` asks for it.

use std::env;
use std::error::Error;
use std::io::{self, Write};
use std::process::ExitCode;

use armwire_host_tests::image::path;
use armwire_host_tests::image::performance::load::{self, SCENES, Scene};
use armwire_host_tests::image::performance::profile::{by_owner, by_package, code};
use armwire_virtual_board::Nanos;

/// How long a scene is played.
const SPAN: Nanos = Nanos::from_millis(100);

/// What is asked for instead of a scene if it is about the image's size.
const CODE: &str = "code";

/// How many functions are shown.
const SHOWN: usize = 40;

fn main() -> ExitCode {
    match show(env::args().nth(1).as_deref()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn show(scene: Option<&str>) -> Result<(), Box<dyn Error>> {
    let names: Vec<String> = SCENES.map(Scene::name).into();
    let chosen = SCENES.into_iter().find(|known| Some(known.name().as_str()) == scene);
    let (counts, unit) = match chosen {
        Some(chosen) => {
            let millis = SPAN.0 / 1_000_000;
            (load::profile(chosen, SPAN), format!("instructions in {millis} ms"))
        }
        None if scene == Some(CODE) => (code(&path())?, "bytes of code".to_owned()),
        None => return Err(format!("name a scene: {}, or {CODE}", names.join(", ")).into()),
    };
    let owners = by_owner(&path(), &counts)?;
    let all: u64 = owners.values().sum();
    let packages = by_package(&owners).into_iter();
    let packages = table(
        all,
        packages.map(|(package, count)| (package.to_owned(), count)),
        usize::MAX,
    );
    let functions = owners
        .iter()
        .map(|(owner, count)| (format!("{}/{}: {}", owner.package, owner.file, owner.function), *count));
    let functions = table(all, functions, SHOWN);
    let text = format!("{all} {unit}\n{packages}\n{functions}");
    Ok(io::stdout().write_all(text.as_bytes())?)
}

/// The most, from the first on.
fn table(all: u64, rows: impl Iterator<Item = (String, u64)>, most: usize) -> String {
    let mut rows: Vec<_> = rows.collect();
    rows.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let share = |count: u64| 100.0 * count as f64 / all as f64;
    rows.iter()
        .take(most)
        .map(|(name, count)| format!("{:5.1} % {count:9}  {name}\n", share(*count)))
        .collect()
}
