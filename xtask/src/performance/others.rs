//! What the other commands measured last, as tables for the page: `cargo xtask bench`, `counts` and `size`.

use std::fmt::Write as _;
use std::fs;

use serde_json::Value;

use crate::Result;
use crate::workspace;

/// Makes a table of what a command has left.
type Table = fn(&[Value]) -> String;

/// A table for each of the commands that has been run.
///
/// # Errors
///
/// If what one has left is not JSON.
pub(super) fn tables() -> Result<Vec<(&'static str, String)>> {
    let mut tables = Vec::new();
    let all: [(&str, Table); 3] = [("bench", bench), ("counts", counts), ("size", size)];
    for (name, table) in all {
        let file = workspace::target_dir()?.join(name).with_extension("json");
        if let Ok(text) = fs::read_to_string(&file) {
            let rows: Vec<Value> =
                serde_json::from_str(&text).map_err(|error| format!("{}: {error}", file.display()))?;
            tables.push((name, table(&rows)));
        }
    }
    Ok(tables)
}

/// The goals, then the times.
fn bench(rows: &[Value]) -> String {
    let mut goals = "| Ling's checksum | What | Measured | Goal |\n|---|---|---:|---:|\n".to_owned();
    let mut times = "| Ling's checksum | What | Whose | A frame, or a hostile byte |\n|---|---|---|---:|\n".to_owned();
    for row in rows {
        let checksum = text(row, "checksum");
        if let Some(goal) = row["goal"].as_str() {
            let (value, limit) = (number(row, "value"), number(row, "limit"));
            let most = if row["at_most"] == true { "≤" } else { "≥" };
            let _ = writeln!(goals, "| {checksum} | {goal} | {value:.2} | {most} {limit} |");
        } else {
            let (what, who, nanos) = (text(row, "what"), text(row, "who"), number(row, "nanoseconds"));
            let _ = writeln!(times, "| {checksum} | {what} | {who} | {nanos:.1} ns |");
        }
    }
    format!("{goals}\n{times}")
}

/// A row for each case, a column for each processor and way to make Ling's checksum.
fn counts(rows: &[Value]) -> String {
    let column = |row: &Value| format!("{}, {}", text(row, "target"), text(row, "checksum"));
    let mut columns: Vec<String> = Vec::new();
    let mut cases: Vec<&str> = Vec::new();
    for row in rows {
        if !columns.contains(&column(row)) {
            columns.push(column(row));
        }
        if !cases.contains(&text(row, "title")) {
            cases.push(text(row, "title"));
        }
    }
    let mut table = format!("| Instructions | {} | Goal |\n", columns.join(" | "));
    table += &format!("|---|{}---:|\n", "---:|".repeat(columns.len()));
    for case in cases {
        let of_case = || rows.iter().filter(|row| text(row, "title") == case);
        let _ = write!(table, "| {case} |");
        for name in &columns {
            let count = of_case()
                .find(|row| column(row) == *name)
                .map(|row| &row["instructions"]);
            let count = count
                .and_then(Value::as_f64)
                .map_or("-".to_owned(), |count| format!("{count:.0}"));
            let _ = write!(table, " {count} |");
        }
        let goal = of_case().find_map(|row| row["goal"].as_f64());
        let goal = goal.map_or("-".to_owned(), |goal| format!("≤ {goal:.0}"));
        let _ = writeln!(table, " {goal} |");
    }
    table
}

/// Flash and RAM, then the stack.
fn size(rows: &[Value]) -> String {
    let mut sizes = "| What | Flash | RAM | Goal |\n|---|---:|---:|---:|\n".to_owned();
    let mut stacks = "| Stack at worst | Cortex-M0 | Cortex-M4 | Goal |\n|---|---:|---:|---:|\n".to_owned();
    for row in rows {
        let name = text(row, "name");
        if let [m0, m4] = row["stack"].as_array().map_or(&[][..], Vec::as_slice) {
            let _ = writeln!(stacks, "| `{name}` | {m0} B | {m4} B | ≤ {} B |", row["stack_goal"]);
            continue;
        }
        let goal = match (&row["flash_goal"], &row["ram_goal"]) {
            (Value::Number(flash), Value::Number(ram)) => format!("≤ {flash} and {ram} B"),
            _ => "-".to_owned(),
        };
        let _ = writeln!(sizes, "| {name} | {} B | {} B | {goal} |", row["flash"], row["ram"]);
    }
    format!("{sizes}\n{stacks}")
}

fn text<'a>(row: &'a Value, key: &str) -> &'a str {
    row[key].as_str().unwrap_or_default()
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_default()
}
