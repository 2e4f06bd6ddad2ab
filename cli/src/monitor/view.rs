//! The screen of a monitor.

use armwire_bridge::Instant;
use armwire_host::describe::Item;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph};

use super::fields::{MISSING, capped, grid, whole, words, words_if_long, wrapped};
use super::model::{Adapter, Model, millis};
use crate::adapter::{histograms, percentile};
use crate::printable::escaped;

/// Width of names, and of a quantity's text.
const NAME: usize = 9;
const WORDS: usize = 22;
/// The most values of a fact that have a line each. The servos of an Alpha1 share lines.
const MOST_LINES: usize = 16;
/// The most lines of a notice.
const MOST_NOTICE: usize = 3;
/// Minimum width of a sparkline.
const LEAST_SPARKLINE: usize = 8;
/// A sparkline's levels.
const LEVELS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
/// Minimum range of a sparkline, in the quantity's unit: a tremor of one tick is a flat line.
const LEAST_RANGE: f64 = 0.02;

const DIM: Style = Style::new().add_modifier(Modifier::DIM);
const BOLD: Style = Style::new().add_modifier(Modifier::BOLD);
const BAD: Style = Style::new().fg(Color::Red);
const LIVE: Style = Style::new().fg(Color::Cyan);

/// A part of the screen.
struct Part {
    title: &'static str,
    lines: Vec<Line<'static>>,
}

/// Draws the screen, as far as there is room.
pub(super) fn draw(frame: &mut Frame<'_>, model: &Model, now: Instant) {
    let area = frame.area();
    let head = head(model, area.width.into());
    let keys = Line::styled("q ends", DIM);
    let keys_width = keys.width() as u16 + 1;
    // A gap stands between the notice and the keys.
    let foot = foot(model, area.width.saturating_sub(keys_width + 1).into());
    let foot = capped(foot, usize::from(area.height / 3).clamp(1, MOST_NOTICE));
    let rows = Layout::vertical([
        Constraint::Length(head.len() as u16),
        Constraint::Fill(1),
        Constraint::Length(foot.len() as u16),
    ]);
    let [head_area, body, foot_area] = rows.areas(area);
    frame.render_widget(Paragraph::new(head), head_area);
    let [left, right] = Layout::horizontal([Constraint::Fill(1), Constraint::Length(keys_width)]).areas(foot_area);
    frame.render_widget(Paragraph::new(foot), left);
    let [_, last] = Layout::vertical([Constraint::Fill(1), Constraint::Length(1)]).areas(right);
    frame.render_widget(keys, last);

    let width = usize::from(body.width).saturating_sub(2);
    let mut parts = vec![arm(model, width), calls(model, now, width)];
    parts.extend(model.adapter.as_ref().map(|shown| adapter(shown, width)));
    let framed: usize = parts.iter().map(|part| part.lines.len() + 2).sum();
    match framed <= usize::from(body.height) {
        true => draw_framed(frame, body, parts),
        false => draw_plain(frame, body, parts),
    }
}

/// The port and the name of the arm.
fn head(model: &Model, width: usize) -> Vec<Line<'static>> {
    let port = Span::styled(escaped(&model.port), BOLD);
    let arm_name = Span::raw(format!(" {}", model.arm));
    wrapped(Span::raw(" "), 1, [port, arm_name], width)
}

/// The notice.
fn foot(model: &Model, width: usize) -> Vec<Line<'static>> {
    let notice = escaped(model.notice.as_deref().unwrap_or_default());
    wrapped(Span::raw(" "), 1, words(&notice, BAD), width)
}

/// Draws each part in a frame with its title.
fn draw_framed(frame: &mut Frame<'_>, area: Rect, parts: Vec<Part>) {
    let heights = parts.iter().map(|part| Constraint::Length(part.lines.len() as u16 + 2));
    let areas = Layout::vertical(heights).split(area);
    for (part, &area) in parts.into_iter().zip(areas.iter()) {
        let block = Block::bordered().title(format!(" {} ", part.title)).border_style(DIM);
        frame.render_widget(Paragraph::new(part.lines).block(block), area);
    }
}

/// Draws the first lines without frames, if there is no room for more.
fn draw_plain(frame: &mut Frame<'_>, area: Rect, parts: Vec<Part>) {
    let mut lines: Vec<_> = parts.into_iter().flat_map(|part| part.lines).collect();
    let room = usize::from(area.height);
    if lines.len() > room && room > 0 {
        let hidden = lines.len() - room + 1;
        lines.truncate(room - 1);
        let mark = Span::styled(format!("{MISSING} {hidden} more lines"), DIM);
        lines.push(Line::from(whole(mark, area.width.into())));
    }
    frame.render_widget(Paragraph::new(lines), area);
}

/// The arm: each value with its history, and the temperatures.
fn arm(model: &Model, width: usize) -> Part {
    let mut lines = Vec::new();
    match &model.latest {
        None => lines.push(Line::styled("nothing received yet", DIM)),
        Some(latest) => {
            let mut values = 0;
            for fact in &latest.facts {
                let first = values;
                values += fact.items.len();
                match fact.items.len() {
                    _ if fact.has_one_text() => {
                        let text = words_if_long(&fact.text.to_string(), NAME, width);
                        lines.extend(wrapped(name(&fact.name), NAME, text, width));
                    }
                    0..=MOST_LINES => {
                        lines.extend(
                            (first..)
                                .zip(&fact.items)
                                .flat_map(|(i, item)| row(model, i, item, width)),
                        );
                    }
                    _ => {
                        lines.extend(wrapped(name(&fact.name), NAME, [], width));
                        let cells = (1..).zip(&fact.items).map(|(n, item)| format!("{n} {}", item.text));
                        lines.extend(grid(cells.collect(), width));
                    }
                }
            }
        }
    }
    if !model.celsius.is_empty() {
        let all = model.celsius.iter().map(u8::to_string);
        let max = model.celsius.iter().max().copied().unwrap_or_default();
        let fields = all.chain(["°C,".to_owned(), format!("the hottest {max} °C")]);
        lines.extend(named("servos", fields, width));
    }
    Part { title: "arm", lines }
}

/// Value number `i` of the readings, with its history.
fn row(model: &Model, i: usize, item: &Item, width: usize) -> Vec<Line<'static>> {
    let mut lines = wrapped(name(&item.name), NAME, words_if_long(&item.text, NAME, width), width);
    let text = WORDS.max(item.text.chars().count());
    let begin = NAME.max(item.name.chars().count() + 1) + text + 1;
    let room = width.saturating_sub(begin);
    if let [line] = &mut lines[..]
        && room >= LEAST_SPARKLINE
        && !item.value.is_string()
    {
        let values: Vec<_> = model.history(i).rev().take(room).collect();
        line.push_span(Span::raw(" ".repeat((begin - 1).saturating_sub(line.width()))));
        line.push_span(Span::styled(format!(" {}", sparkline(&values)), LIVE));
    }
    lines
}

/// The line: calls, or received readings.
fn calls(model: &Model, now: Instant, width: usize) -> Part {
    let achieved = model.achieved(now);
    let wanted = model.rate.map_or(String::new(), |rate| format!(" of {rate}"));
    let mut rate = vec![format!("{achieved:.1}{wanted} readings/s,")];
    match model.requests {
        0 => rate.push(format!("received {}", model.answered)),
        requests => rate.extend([format!("requested {requests},"), format!("answered {}", model.answered)]),
    }
    let mut lines = named("rate", rate, width);
    if let Some(times) = model.call_times() {
        let [least, median, worst] = [times.min, times.median, times.worst].map(millis);
        let fields = [
            format!("minimum {least},"),
            format!("median {median},"),
            format!("maximum {worst}"),
        ];
        lines.extend(named("latency", fields, width));
    }
    if model.rate.is_some() {
        let errors = [
            (model.timed_out, "unanswered,"),
            (model.line_errors.checksums as u64, "wrong checksums,"),
            (model.line_errors.noise_bytes as u64, "noise bytes"),
        ];
        let fields = errors.map(|(count, what)| {
            let style = if count > 0 { BAD } else { Style::new() };
            Span::styled(format!("{count} {what}"), style)
        });
        lines.extend(wrapped(name("errors"), NAME, fields, width));
    }
    Part { title: "line", lines }
}

/// The adapter: its latencies, and the counters that are not zero.
fn adapter(adapter: &Adapter, width: usize) -> Part {
    let mut lines = wrapped(
        name("adapter"),
        NAME,
        words_if_long(&escaped(&adapter.name), NAME, width),
        width,
    );
    match &adapter.counts {
        Err(error) => lines.extend(wrapped(Span::raw(""), 0, words(&escaped(error), BAD), width)),
        Ok((counters, latencies)) => {
            for (what, _, histogram) in histograms(latencies) {
                if let [Some(half), Some(most), Some(all)] = [50, 99, 100].map(|percent| percentile(histogram, percent))
                {
                    let fields = [format!("median {half},"), format!("99 % {most},"), format!("max {all}")];
                    lines.extend(named(what, fields, width));
                }
            }
            let counted = counters.iter().filter(|&(_, count)| count != 0);
            let cells = counted.map(|(name, count)| format!("{name} {count}"));
            lines.extend(grid(cells.collect(), width));
        }
    }
    Part {
        title: "adapter",
        lines,
    }
}

/// The lines of these fields behind a name.
fn named(what: &str, fields: impl IntoIterator<Item = String>, width: usize) -> Vec<Line<'static>> {
    wrapped(name(what), NAME, fields.into_iter().map(Span::raw), width)
}

fn name(text: &str) -> Span<'static> {
    Span::styled(format!("{text:<width$} ", width = NAME - 1), DIM)
}

/// Bars of values, scaled between minimum and maximum. `values` has the newest first, the text has it last.
fn sparkline(values: &[Option<f64>]) -> String {
    let known = || values.iter().flatten().copied().filter(|value| value.is_finite());
    let (min, max) = (
        known().fold(f64::INFINITY, f64::min),
        known().fold(f64::NEG_INFINITY, f64::max),
    );
    let range = (max - min).max(LEAST_RANGE);
    let bottom = (min + max - range) / 2.0;
    let bar = |value: &Option<f64>| match value {
        Some(value) if value.is_finite() => {
            let level = (value - bottom) / range * (LEVELS.len() - 1) as f64;
            LEVELS[(level.round() as usize).min(LEVELS.len() - 1)]
        }
        _ => ' ',
    };
    values.iter().rev().map(bar).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;
    use std::path::Path;
    use std::{env, fs};

    use anstyle_svg::{Term, WIN10_CONSOLE};
    use armwire::alpha1::{self, Alpha1, ServoStates};
    use armwire::ling::legacy::{self, Legacy};
    use armwire::ling::{JointState, Ling, MotionStatus, Response};
    use armwire::time::Duration;
    use armwire::xarm::{State, XArm};
    use armwire_bridge::Counters;
    use armwire_bridge::control::Latencies;
    use armwire_host::describe::{self, Arm};
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use ratatui::buffer::{Buffer, Cell};

    use super::*;
    use crate::monitor::model::Latest;
    use crate::monitor::model::tests::latest;

    /// A screen of this size, at 1 s.
    fn cells(model: &Model, width: u16, height: u16) -> Buffer {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).unwrap();
        terminal
            .draw(|frame| draw(frame, model, Instant::from_millis(1_000)))
            .unwrap();
        terminal.backend().buffer().clone()
    }

    /// The lines of a screen of this size.
    fn screen(model: &Model, width: u16, height: u16) -> Vec<String> {
        let buffer = cells(model, width, height);
        let cells = buffer.content().chunks(width.into());
        cells
            .map(|row| {
                row.iter()
                    .map(|cell| cell.symbol())
                    .collect::<String>()
                    .trim_end()
                    .to_owned()
            })
            .collect()
    }

    /// A model of an arm with six joints. The first joint has moved.
    fn model() -> Model {
        let mut model = Model::new("/dev/ttyACM0");
        model.watch("a Ling arm", 10, Some(20));
        for n in 0..20_u16 {
            model.requests += 1;
            let moved = Some(f32::from(n) / 20.0);
            model.read(latest(
                u64::from(n) * 50,
                1_250,
                &[moved, Some(0.0), Some(0.0), None, Some(0.0), Some(0.0)],
            ));
        }
        model.celsius = vec![31, 30, 45];
        model
    }

    fn counted() -> Adapter {
        let mut counters = Counters::default();
        counters.frames = 1234;
        counters.framing_errors = 2;
        let mut latencies = Latencies::default();
        latencies.answer.counts[8] = 100;
        Adapter {
            name: "stm32f405, firmware 0.1.0".to_owned(),
            counts: Ok((counters, latencies)),
        }
    }

    /// A model of a Ling arm that moves behind an adapter.
    fn moving() -> Model {
        let mut model = Model::new("/dev/ttyACM0");
        model.watch("a Ling arm", 10, Some(50));
        for n in 0..50_u16 {
            model.requests += 1;
            let up = 2_048 + n * 14;
            let down = 2_048 - n * 6;
            let there_and_back = 2_248 - (n * 16).abs_diff(400) / 2;
            let state = JointState {
                joints: [up, down, there_and_back, 2_048, down, up],
                gripper: 500 + n * 6,
                status: MotionStatus::Locked,
            };
            model.read(Latest {
                facts: Ling::facts(&Response::Joints(state)),
                at: Instant::from_millis(u64::from(n) * 20),
                stamp: None,
                latency: Some(Duration::from_micros(610 + u64::from(n % 7) * 20)),
            });
        }
        model.celsius = vec![31, 30, 33, 35, 31, 29, 30, 30, 31, 28];
        model.adapter = Some(counted());
        model
    }

    /// A row as text with the styles for a terminal.
    fn styled(row: &[Cell]) -> String {
        let parts = row.chunk_by(|one, next| one.style() == next.style());
        let part = |cells: &[Cell]| {
            let text: String = cells.iter().map(Cell::symbol).collect();
            let mut codes = String::new();
            for (is_set, code) in [
                (cells[0].modifier.contains(Modifier::BOLD), "\x1B[1m"),
                (cells[0].modifier.contains(Modifier::DIM), "\x1B[2m"),
                (cells[0].fg == Color::Red, "\x1B[31m"),
                (cells[0].fg == Color::Cyan, "\x1B[36m"),
            ] {
                codes += if is_set { code } else { "" };
            }
            format!("{codes}{text}\x1B[0m")
        };
        parts.map(part).collect()
    }

    /// The lines of a screen that are not empty, without frames.
    fn lines(screen: &[String]) -> Vec<&str> {
        let lines = screen.iter().map(|line| line.trim_matches('│').trim_end());
        lines
            .filter(|line| !line.is_empty() && !line.starts_with(['┌', '└']))
            .collect()
    }

    /// The fields of a screen, in their order: what is between spaces, without sparklines.
    fn fields(screen: &[String]) -> Vec<&str> {
        let fields = lines(screen).into_iter().flat_map(str::split_whitespace);
        fields.filter(|field| !field.contains(LEVELS)).collect()
    }

    /// A model of each arm, with long numbers.
    fn arms() -> Vec<Model> {
        let half = [-2.5_f32; 7].map(f32::to_le_bytes);
        let legacy = legacy::Response::Joints(legacy::JointState {
            firmware: legacy::Firmware::V5,
            servos: [1000; legacy::SERVOS],
        });
        let readings = [
            ("a Ling arm", moving().latest.unwrap().facts),
            (Legacy::NAME, {
                let mut facts = Legacy::facts(&legacy);
                facts.extend(describe::legacy::gripper(None));
                facts
            }),
            (
                XArm::NAME,
                describe::xarm::positions(State::WARNING, half.as_flattened(), Some(7)),
            ),
            (XArm::NAME, describe::xarm::positions(State::OK, &[1; 40], None)),
            (
                Alpha1::NAME,
                Alpha1::facts(&alpha1::Response::ServoStates(ServoStates::from_bits(u32::MAX))),
            ),
            (
                Alpha1::NAME,
                Alpha1::facts(&alpha1::Response::ServoStates(ServoStates::from_bits(0x7FFB))),
            ),
        ];
        let arms = readings.into_iter().map(|(arm, facts)| {
            let mut model = Model::new("can:can0/3");
            model.watch(arm, 10, Some(1000));
            model.requests = 1_234_567;
            model.line_errors.noise_bytes = 7_654_321;
            model.line_errors.checksums = 1_010_101;
            model.read(Latest {
                facts,
                at: Instant::from_millis(900),
                stamp: None,
                latency: Some(Duration::from_micros(1_234_560)),
            });
            model.answered = 1_234_115;
            model.timed_out = 452;
            model.celsius = vec![31, 30, 33, 35, 31, 29, 30, 30, 31, 128];
            model.notice = Some("no answer in 350 ms: is the arm on, and is 1000000 its baud rate?".to_owned());
            let mut adapter = counted();
            if let Ok((counters, latencies)) = &mut adapter.counts {
                counters.frames = u32::MAX;
                counters.framing_errors = u32::MAX;
                latencies.turn.counts[15] = 7;
            }
            model.adapter = Some(adapter);
            model
        });
        arms.collect()
    }

    #[test]
    fn fields_are_whole_at_every_width() {
        for model in arms() {
            let widest = screen(&model, 300, 200);
            let all = fields(&widest);
            assert!(!all.contains(&MISSING), "{all:?}");
            for width in 40..=120 {
                assert_eq!(fields(&screen(&model, width, 200)), all, "{} at {width}", model.arm);
            }
        }
    }

    #[test]
    fn servo_that_is_off_differs_from_one_that_is_not_there() {
        let some = arms().pop().unwrap();
        let screen = screen(&some, 80, 60);
        assert_shown(
            &screen,
            &[
                "│servos that run",
                "│1 runs   2 runs   3 off    4 runs",
                " 16 off ",
                "│17 -     18 -",
            ],
        );
    }

    #[test]
    fn low_screen_has_whole_fields_and_counts_the_rest() {
        for model in arms() {
            for width in [40, 60, 80, 100, 120] {
                let high = screen(&model, width, 200);
                let all = lines(&high);
                for height in [10, 16, 24] {
                    let low = screen(&model, width, height);
                    let (marks, shown): (Vec<_>, Vec<_>) =
                        lines(&low).into_iter().partition(|line| line.starts_with(MISSING));
                    assert!(shown.iter().all(|line| all.contains(line)), "{}", low.join("\n"));
                    let hidden = marks
                        .iter()
                        .map(|mark| mark.split(' ').nth(1).unwrap().parse::<usize>().unwrap());
                    assert_eq!(shown.len() + hidden.sum::<usize>(), all.len(), "{}", low.join("\n"));
                }
            }
        }
    }

    #[test]
    fn field_wider_than_its_line_is_marked() {
        let mut model = model();
        model.port = format!("/dev/serial/by-id/{}", "1".repeat(60));
        model.notice = Some(format!("{} 350 ms", "2".repeat(60)));
        model.adapter = Some(Adapter {
            name: "3".repeat(60),
            ..counted()
        });
        let narrow = screen(&model, 40, 40);
        assert_shown(&narrow, &[" …  Ling arm", "│adapter  …", " … 350 ms"]);
        for digits in ["11", "22", "33"] {
            assert!(
                narrow.iter().all(|line| !line.contains(digits)),
                "{}",
                narrow.join("\n")
            );
        }
        assert_shown(&screen(&model, 120, 40), &["111", "222", "333"]);
    }

    fn assert_shown(screen: &[String], texts: &[&str]) {
        for text in texts {
            assert!(
                screen.iter().any(|line| line.contains(text)),
                "{text} is not in\n{}",
                screen.join("\n")
            );
        }
    }

    #[test]
    fn wide_screen_shows_everything() {
        let mut model = model();
        model.line_errors.noise_bytes = 7;
        model.line_errors.checksums = 1;
        model.adapter = Some(counted());
        model.notice = Some("no answer in 350 ms".to_owned());
        let screen = screen(&model, 100, 30);
        assert_shown(
            &screen,
            &[
                " /dev/ttyACM0  Ling arm",
                "┌ arm ─",
                "│joint 1  0.95 rad",
                "▁▂▃▃▄▅▆▆▇█",
                "│joint 4  ?",
                "│status   locked",
                "│servos   31 30 45 °C, the hottest 45 °C",
                "│rate     20.0 of 20 readings/s, requested 20, answered 20",
                "│latency  minimum 1.25 ms, median 1.25 ms, maximum 1.25 ms",
                "│errors   0 unanswered, 1 wrong checksums, 7 noise bytes",
                "│adapter  stm32f405, firmware 0.1.0",
                "│answer   median < 512 µs, 99 % < 512 µs, max < 512 µs",
                "│frames 1234       framing_errors 2",
                " no answer in 350 ms",
            ],
        );
        assert!(screen.last().unwrap().ends_with("q ends"));
        assert!(screen.iter().all(|line| !line.contains("noise_errors")), "it is zero");
    }

    /// `ARMWIRE_WRITE=1 cargo test -p armwire-cli screen_in_readme` draws it.
    #[test]
    fn screen_in_readme_is_current() {
        let buffer = cells(&moving(), 92, 26);
        let rows = buffer.content().chunks(buffer.area.width.into());
        let rows: Vec<_> = rows.map(styled).collect();
        let drawn = Term::new().palette(WIN10_CONSOLE).render_svg(&rows.join("\n"));
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("doc/monitor.svg");
        if env::var_os("ARMWIRE_WRITE").is_some() {
            fs::write(&file, &drawn).unwrap();
        }
        assert!(fs::read_to_string(&file).unwrap() == drawn, "{} is old", file.display());
    }

    #[test]
    fn narrow_screen_has_no_sparklines() {
        let screen = screen(&model(), 40, 24);
        assert_shown(
            &screen,
            &["joint 1  0.95 rad", "status   locked", "latency  minimum 1.25 ms"],
        );
        assert!(
            screen.iter().all(|line| !line.contains(LEVELS)),
            "{}",
            screen.join("\n")
        );
    }

    #[test]
    fn low_screen_counts_its_hidden_lines() {
        let mut model = model();
        model.adapter = Some(counted());
        let screen = screen(&model, 80, 10);
        assert_shown(&screen, &["joint 1  0.95 rad", "… 7 more lines", "q ends"]);
        assert!(screen.iter().all(|line| !line.contains('┌')), "{}", screen.join("\n"));
    }

    #[test]
    fn no_screen_is_too_small() {
        for (width, height) in [(0, 0), (1, 1), (2, 3), (5, 2), (300, 1), (1, 100)] {
            screen(&model(), width.max(1), height.max(1));
        }
    }

    #[test]
    fn arm_without_requests_has_no_calls() {
        let mut model = Model::new("control:/tmp/control");
        model.watch("a Ling arm", 10, None);
        assert_shown(
            &screen(&model, 80, 24),
            &["nothing received yet", "0.0 readings/s, received 0"],
        );
        let mut latest = latest(900, 0, &[Some(1.0)]);
        latest.latency = None;
        model.read(latest);
        let screen = screen(&model, 80, 24);
        assert_shown(&screen, &["received 1"]);
        assert!(
            screen
                .iter()
                .all(|line| !line.contains("latency") && !line.contains("errors"))
        );
    }

    #[test]
    fn lost_adapter_is_shown() {
        let mut model = model();
        model.adapter = Some(Adapter {
            counts: Err("the adapter is gone".to_owned()),
            ..counted()
        });
        assert_shown(&screen(&model, 80, 24), &["the adapter is gone"]);
    }

    #[test]
    fn sparkline_spans_the_range_and_flattens_tremor() {
        assert_eq!(sparkline(&[Some(2.0), Some(1.0), None, Some(0.0)]), "▁ ▅█");
        assert_eq!(sparkline(&[Some(0.001), Some(0.0)]), "▄▅");
        assert_eq!(sparkline(&[Some(f64::NAN), None]), "  ");
        assert_eq!(sparkline(&Vec::from(VecDeque::<Option<f64>>::new())), "");
    }
}
