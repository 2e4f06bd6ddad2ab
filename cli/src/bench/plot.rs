//! Measurements as a drawing: the share of calls above a duration.

use std::fmt::Write;
use std::time::Duration;

use armwire_host::Rate;

use super::measure::{Call, Run};

/// Size of a rate's panel, and of the space around its axes.
const WIDTH: f64 = 330.0;
const HEIGHT: f64 = 300.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 52.0;
const BOTTOM: f64 = 44.0;
/// Ends of the axes, as powers of ten: 0.1 µs to 1 s, and all calls to one in 100,000.
const FROM: i32 = -7;
const TO: i32 = 0;
const LEAST: i32 = -5;
/// The least width of a step.
const LEAST_STEP: f64 = 0.5;

/// An SVG drawing with a panel for each rate, and a line for each measurement: the share of calls that took longer.
pub(super) fn svg(runs: &[Run]) -> String {
    let mut rates: Vec<Rate> = Vec::new();
    for run in runs {
        if !rates.contains(&run.rate) {
            rates.push(run.rate);
        }
    }
    let width = WIDTH * rates.len() as f64;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{HEIGHT}\" viewBox=\"0 0 {width} {HEIGHT}\" \
         font-family=\"sans-serif\" font-size=\"11\">\n<rect width=\"{width}\" height=\"{HEIGHT}\" fill=\"#fff\"/>\n"
    );
    for (panel, &rate) in rates.iter().enumerate() {
        let _ = writeln!(svg, "<g transform=\"translate({} 0)\">", WIDTH * panel as f64);
        axes(&mut svg, rate);
        for (row, run) in runs.iter().filter(|run| run.rate == rate).enumerate() {
            line(&mut svg, run, row);
        }
        svg += "</g>\n";
    }
    svg + "</svg>\n"
}

/// The horizontal place of a duration in seconds.
fn x(seconds: f64) -> f64 {
    let share = (seconds.log10() - f64::from(FROM)) / f64::from(TO - FROM);
    LEFT + share.clamp(0.0, 1.0) * (WIDTH - LEFT - RIGHT)
}

/// The vertical place of a share of calls.
fn y(share: f64) -> f64 {
    let depth = share.log10() / f64::from(LEAST);
    TOP + depth.clamp(0.0, 1.0) * (HEIGHT - TOP - BOTTOM)
}

/// The grid of a panel, and its texts.
fn axes(svg: &mut String, rate: Rate) {
    let (middle, bottom) = ((LEFT + WIDTH - RIGHT) / 2.0, HEIGHT - BOTTOM);
    let title = format!("{} Hz: share of calls above a duration", rate.hertz());
    let _ = writeln!(
        svg,
        "<text x=\"{middle}\" y=\"16\" text-anchor=\"middle\">{title}</text>"
    );
    let labels = ["0.1 µs", "1 µs", "10 µs", "0.1 ms", "1 ms", "10 ms", "0.1 s", "1 s"];
    for (power, label) in (FROM..=TO).zip(labels) {
        let (x, below) = (x(10_f64.powi(power)), bottom + 16.0);
        let _ = writeln!(
            svg,
            "<path d=\"M{x:.1} {TOP}V{bottom}\" stroke=\"#ddd\"/><text x=\"{x:.1}\" y=\"{below}\" \
             text-anchor=\"middle\" font-size=\"9\">{label}</text>"
        );
    }
    for power in LEAST..=0 {
        let (y, right, left) = (y(10_f64.powi(power)), WIDTH - RIGHT, LEFT - 6.0);
        let label = 10_f64.powi(power + 2);
        let _ = writeln!(
            svg,
            "<path d=\"M{LEFT} {y:.1}H{right}\" stroke=\"#ddd\"/><text x=\"{left}\" y=\"{:.1}\" \
             text-anchor=\"end\">{label} %</text>",
            y + 4.0
        );
    }
}

/// The line of a measurement, and its row in the legend.
fn line(svg: &mut String, run: &Run, row: usize) {
    let colour = match run.call {
        Call::Read => "#c2410c",
        Call::Latest => "#0d9488",
    };
    let dashes = if run.is_loaded { " stroke-dasharray=\"5 3\"" } else { "" };
    let calls = run.calls.ascending();
    let mut path = format!("M{LEFT:.1} {:.1}", y(1.0));
    let mut drawn = LEFT;
    for (below, duration) in calls.iter().enumerate() {
        // A step at each duration; steps at nearly the same place are one.
        let after = calls.get(below + 1);
        if after.is_none_or(|after| place(*after) - drawn >= LEAST_STEP) {
            drawn = place(*duration);
            let share = (calls.len() - below - 1) as f64 / calls.len() as f64;
            let _ = write!(path, "H{:.1}V{:.1}", place(*duration), y(share));
        }
    }
    let (load, x, y) = (
        if run.is_loaded { ", busy" } else { "" },
        LEFT - 18.0 + 70.0 * row as f64,
        TOP - 14.0,
    );
    let _ = writeln!(
        svg,
        "<path d=\"{path}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"1.5\"{dashes}/><path d=\"M{x} {y}h14\" \
         stroke=\"{colour}\" stroke-width=\"2\"{dashes}/><text x=\"{}\" y=\"{}\" font-size=\"9\">{}{load}</text>",
        x + 17.0,
        y + 4.0,
        run.call
    );
}

fn place(duration: Duration) -> f64 {
    x(duration.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::super::measure::Durations;
    use super::*;

    fn run(call: Call, hertz: u16, is_loaded: bool) -> Run {
        Run {
            call,
            rate: Rate::new(hertz).unwrap(),
            is_loaded,
            calls: Durations::new([10, 100, 1_000, 100_000].map(Duration::from_micros).to_vec()),
            ages: Durations::default(),
            missed: 0,
            failed: 0,
            reader: None,
        }
    }

    #[test]
    fn each_rate_has_a_panel_with_its_lines() {
        let svg = svg(&[
            run(Call::Read, 50, false),
            run(Call::Latest, 50, true),
            run(Call::Read, 200, false),
        ]);
        assert_eq!(svg.matches("share of calls above").count(), 2);
        assert_eq!(svg.matches("stroke-width=\"1.5\"").count(), 3);
        assert_eq!(svg.matches("latest, busy</text>").count(), 1);
        assert_eq!(svg.matches("<g ").count(), svg.matches("</g>").count());
        assert!(svg.ends_with("</svg>\n"));
    }

    #[test]
    fn line_falls_to_the_right_of_each_duration() {
        let mut svg = String::new();
        line(&mut svg, &run(Call::Read, 50, false), 0);
        let steps = [(10, 0.75), (100, 0.5), (1_000, 0.25), (100_000, 0.0)];
        let steps =
            steps.map(|(micros, share)| format!("H{:.1}V{:.1}", place(Duration::from_micros(micros)), y(share)));
        assert!(svg.contains(&steps.concat()), "{svg}");
    }

    #[test]
    fn close_durations_still_make_a_slope() {
        let mut many = run(Call::Read, 50, false);
        many.calls = Durations::new((1_000..2_000).map(Duration::from_micros).collect());
        let mut svg = String::new();
        line(&mut svg, &many, 0);
        let steps = svg.matches('H').count();
        assert!((10..200).contains(&steps), "{steps} steps");
    }

    #[test]
    fn durations_beyond_the_axes_are_at_their_ends() {
        assert_eq!((x(0.0), x(100.0)), (LEFT, WIDTH - RIGHT));
        assert_eq!((y(1.0), y(0.0)), (TOP, HEIGHT - BOTTOM));
    }
}
