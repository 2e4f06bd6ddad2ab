//! Plots, as SVG that can be read on a light and on a dark page.

use std::fmt::Write as _;

/// The size of a plot, and where its axes are.
const WIDTH: f64 = 760.0;
const HEIGHT: f64 = 380.0;
const LEFT: f64 = 90.0;
const RIGHT: f64 = 20.0;
const TOP: f64 = 64.0;
const BOTTOM: f64 = 52.0;

/// Colours that are told apart by everybody (Okabe and Ito), and dashes for print.
const COLOURS: [&str; 4] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7"];
const DASHES: [&str; 4] = ["none", "7 3", "2 3", "9 3 2 3"];

const STYLE: &str = "\
text { font: 13px sans-serif; fill: #24292f } .title { font-size: 15px; font-weight: bold }
.page { fill: #ffffff } .axis { stroke: #57606a } .grid { stroke: #d0d7de } .goal { stroke: #cf222e } .limit { fill: #cf222e }
@media (prefers-color-scheme: dark) { text { fill: #e6edf3 } .page { fill: #0d1117 } .axis { stroke: #8d96a0 }
.grid { stroke: #30363d } .goal { stroke: #ff7b72 } .limit { fill: #ff7b72 } }";

/// An axis: what is on it and in what unit, from where to where, and where it is labelled.
#[derive(Debug)]
pub(super) struct Axis<'a> {
    pub(super) name: &'a str,
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) ticks: Vec<(f64, String)>,
}

impl Axis<'_> {
    /// Where `value` is, from 0 to 1.
    fn place(&self, value: f64) -> f64 {
        ((value - self.from) / (self.to - self.from)).clamp(0.0, 1.0)
    }
}

/// A line in a plot.
#[derive(Debug)]
pub(super) struct Series<'a> {
    pub(super) name: &'a str,
    pub(super) points: Vec<(f64, f64)>,
    /// Whether each point is marked.
    pub(super) marked: bool,
}

/// A straight line at what is to be reached.
#[derive(Debug)]
pub(super) struct Goal {
    pub(super) name: String,
    pub(super) at: f64,
    /// Whether it is a value of the x axis.
    pub(super) upright: bool,
}

/// Lines over two axes.
pub(super) fn lines(title: &str, x: &Axis<'_>, y: &Axis<'_>, goal: &Goal, series: &[Series<'_>]) -> String {
    let across = |value: f64| LEFT + x.place(value) * (WIDTH - LEFT - RIGHT);
    let up = |value: f64| HEIGHT - BOTTOM - y.place(value) * (HEIGHT - TOP - BOTTOM);
    let mut svg = begin(title);
    for (value, label) in &x.ticks {
        let at = across(*value);
        line(&mut svg, "grid", (at, TOP), (at, HEIGHT - BOTTOM));
        text(&mut svg, (at, HEIGHT - BOTTOM + 17.0), "middle", label);
    }
    for (value, label) in &y.ticks {
        let at = up(*value);
        line(&mut svg, "grid", (LEFT, at), (WIDTH - RIGHT, at));
        text(&mut svg, (LEFT - 7.0, at + 4.0), "end", label);
    }
    line(
        &mut svg,
        "axis",
        (LEFT, HEIGHT - BOTTOM),
        (WIDTH - RIGHT, HEIGHT - BOTTOM),
    );
    line(&mut svg, "axis", (LEFT, TOP), (LEFT, HEIGHT - BOTTOM));
    text(
        &mut svg,
        ((LEFT + WIDTH - RIGHT) / 2.0, HEIGHT - 12.0),
        "middle",
        x.name,
    );
    let middle = (TOP + HEIGHT - BOTTOM) / 2.0;
    let _ = writeln!(
        svg,
        r#"<text transform="translate(16 {middle:.1}) rotate(-90)" text-anchor="middle">{}</text>"#,
        y.name
    );
    let (from, to, label) = match goal.upright {
        true => (
            (across(goal.at), TOP),
            (across(goal.at), HEIGHT - BOTTOM),
            (across(goal.at) + 6.0, HEIGHT - BOTTOM - 8.0),
        ),
        false => (
            (LEFT, up(goal.at)),
            (WIDTH - RIGHT, up(goal.at)),
            (LEFT + 8.0, up(goal.at) - 6.0),
        ),
    };
    line(&mut svg, "goal", from, to);
    limit(&mut svg, label, &goal.name);
    for (nth, series) in series.iter().enumerate() {
        let (colour, dash) = (COLOURS[nth % COLOURS.len()], DASHES[nth % DASHES.len()]);
        let mut path = String::new();
        for &(a, b) in &series.points {
            let _ = write!(path, "{:.1},{:.1} ", across(a), up(b));
        }
        let _ = writeln!(
            svg,
            r#"<polyline points="{}" fill="none" stroke="{colour}" stroke-width="2" stroke-dasharray="{dash}"/>"#,
            path.trim_end()
        );
        for &(a, b) in series.points.iter().filter(|_| series.marked) {
            let _ = writeln!(
                svg,
                r#"<circle cx="{:.1}" cy="{:.1}" r="3.5" fill="{colour}"/>"#,
                across(a),
                up(b)
            );
        }
        let at = LEFT + nth as f64 * (WIDTH - LEFT - RIGHT) / 4.0;
        let _ = writeln!(
            svg,
            r#"<line x1="{at:.1}" y1="44" x2="{:.1}" y2="44" stroke="{colour}" stroke-width="3" stroke-dasharray="{dash}"/>"#,
            at + 26.0
        );
        text(&mut svg, (at + 32.0, 48.0), "start", series.name);
    }
    svg + "</svg>\n"
}

/// Bars, each with a name and a value of the axis, as long as that.
pub(super) fn bars(title: &str, axis: &Axis<'_>, goal: &Goal, bars: &[(String, f64, String)]) -> String {
    const NAMES: f64 = 250.0;
    const LABELS: f64 = 60.0;
    let across = |value: f64| NAMES + axis.place(value) * (WIDTH - NAMES - LABELS);
    let step = (HEIGHT - TOP - BOTTOM) / bars.len().max(1) as f64;
    let mut svg = begin(title);
    for (value, label) in &axis.ticks {
        let at = across(*value);
        line(&mut svg, "grid", (at, TOP), (at, HEIGHT - BOTTOM));
        text(&mut svg, (at, HEIGHT - BOTTOM + 17.0), "middle", label);
    }
    text(
        &mut svg,
        ((NAMES + WIDTH - LABELS) / 2.0, HEIGHT - 12.0),
        "middle",
        axis.name,
    );
    for (nth, (name, value, label)) in bars.iter().enumerate() {
        let top = TOP + nth as f64 * step;
        let _ = writeln!(
            svg,
            r#"<rect x="{NAMES}" y="{:.1}" width="{:.1}" height="{:.1}" fill="{}"/>"#,
            top + step * 0.18,
            across(*value) - NAMES,
            step * 0.64,
            COLOURS[0]
        );
        text(&mut svg, (NAMES - 8.0, top + step / 2.0 + 4.0), "end", name);
        text(&mut svg, (across(*value) + 6.0, top + step / 2.0 + 4.0), "start", label);
    }
    line(&mut svg, "axis", (NAMES, TOP), (NAMES, HEIGHT - BOTTOM));
    line(
        &mut svg,
        "goal",
        (across(goal.at), TOP - 6.0),
        (across(goal.at), HEIGHT - BOTTOM),
    );
    limit(&mut svg, (across(goal.at) - 4.0, TOP - 11.0), &goal.name);
    svg + "</svg>\n"
}

fn begin(title: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" height=\"{HEIGHT}\">\n\
         <style>{STYLE}</style>\n<rect class=\"page\" width=\"{WIDTH}\" height=\"{HEIGHT}\"/>\n\
         <text class=\"title\" x=\"{}\" y=\"22\" text-anchor=\"middle\">{title}</text>\n",
        WIDTH / 2.0
    )
}

fn line(svg: &mut String, class: &str, from: (f64, f64), to: (f64, f64)) {
    let ((x1, y1), (x2, y2)) = (from, to);
    let _ = writeln!(
        svg,
        r#"<line class="{class}" x1="{x1:.1}" y1="{y1:.1}" x2="{x2:.1}" y2="{y2:.1}"/>"#
    );
}

fn text(svg: &mut String, (x, y): (f64, f64), anchor: &str, text: &str) {
    let _ = writeln!(
        svg,
        r#"<text x="{x:.1}" y="{y:.1}" text-anchor="{anchor}">{text}</text>"#
    );
}

fn limit(svg: &mut String, (x, y): (f64, f64), text: &str) {
    let _ = writeln!(svg, r#"<text class="limit" x="{x:.1}" y="{y:.1}">{text}</text>"#);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_where_the_axis_has_it_and_nothing_leaves_the_plot() {
        let axis = Axis {
            name: "µs",
            from: 0.0,
            to: 20.0,
            ticks: vec![(0.0, "0".to_owned()), (20.0, "20".to_owned())],
        };
        assert_eq!(
            [0.0, 5.0, 20.0, 25.0].map(|value| axis.place(value)),
            [0.0, 0.25, 1.0, 1.0]
        );
        let goal = Goal {
            name: "goal".to_owned(),
            at: 10.0,
            upright: true,
        };
        let series = Series {
            name: "way",
            points: vec![(0.0, 0.0), (20.0, 20.0)],
            marked: false,
        };
        let svg = lines("title", &axis, &axis, &goal, &[series]);
        let corners = format!("{LEFT:.1},{:.1} {:.1},{TOP:.1}", HEIGHT - BOTTOM, WIDTH - RIGHT);
        assert!(svg.contains(&corners), "{svg}");
    }
}
