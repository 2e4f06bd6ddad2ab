//! The plots of the page, as SVG.

use std::fs;
use std::path::Path;

use plotters::coord::CoordTranslate;
use plotters::prelude::*;

use crate::latency::WAYS;
use crate::scenes::{Figures, Scene};
use crate::{Measured, Result};

/// Sizes in pixels: the plot of latency, a plot with bars, and the space for the names of bars.
const WIDE: (u32, u32) = (900, 360);
const NARROW: (u32, u32) = (560, 440);
const NAMES: u32 = 200;
/// Space for legends and labels: the axis relative to the worst time, the axis in percent, and rows above the first.
const TIME_ROOM: f64 = 1.7;
const PERCENT_ROOM: f64 = 117.0;
const LEGEND_ROWS: usize = 2;

/// Colours that colour-blind people can tell apart (Okabe and Ito).
const COLOURS: [RGBColor; 4] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
];

/// Smallest share in the plots, and number of steps down to it.
const LEAST: f64 = 1e-4;
const STEPS: u32 = 400;

/// Writes all plots. Each chip is shown with its own timing, if measured.
pub(crate) fn write(folder: &Path, boards: &[Measured]) -> Result<()> {
    let is_better = |one: &Measured, other: &Measured| one.board.chip == other.board.chip && one.board.exact;
    let has_better = |shown: &Measured| !shown.board.exact && boards.iter().any(|other| is_better(other, shown));
    let boards: Vec<&Measured> = boards.iter().filter(|shown| !has_better(shown)).collect();
    fs::create_dir_all(folder)?;
    latency(&folder.join("latency.svg"), &boards)?;
    let load = |figures: &Figures| Some(figures.load);
    bars(&folder.join("load.svg"), "load of the core", &boards, load)?;
    let rate = |figures: &Figures| figures.rate.as_ref().map(|rate| rate.percent);
    bars(&folder.join("rates.svg"), "share of the wire limit", &boards, rate)
}

/// Plots the share of latencies above a time, for each board.
fn latency(file: &Path, boards: &[&Measured]) -> Result<()> {
    let worst = boards
        .iter()
        .flat_map(|measured| measured.latency.ways.iter().map(|way| way.quantile(1.0)));
    let longest = worst.fold(0.0, f64::max) * TIME_ROOM;
    let root = SVGBackend::new(file, WIDE).into_drawing_area();
    root.fill(&WHITE)?;
    for (measured, panel) in boards.iter().zip(root.split_evenly((1, boards.len()))) {
        let mut chart = ChartBuilder::on(&panel)
            .caption(measured.board.name(), ("sans-serif", 18))
            .margin(14)
            .x_label_area_size(44)
            .y_label_area_size(74)
            .build_cartesian_2d(0.0..longest, (LEAST..1.0).log_scale())?;
        chart
            .configure_mesh()
            .light_line_style(WHITE)
            .x_desc("latency added by the adapter, µs")
            .y_desc("share taking longer")
            .x_label_formatter(&|micros| format!("{micros:.0}"))
            .y_label_formatter(&|share| format!("{} %", 100.0 * share))
            .draw()?;
        for ((way, spans), colour) in WAYS.iter().zip(&measured.latency.ways).zip(COLOURS) {
            let shares = (0..=STEPS).map(|step| LEAST.powf(f64::from(step) / f64::from(STEPS)));
            let points = shares.map(|share| (spans.quantile(1.0 - share), share));
            chart
                .draw_series(LineSeries::new(points, colour.stroke_width(2)))?
                .label(*way)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2)));
        }
        draw_legend(&mut chart)?;
    }
    Ok(root.present()?)
}

/// Plots a bar in percent for each board in each scene.
fn bars(file: &Path, axis: &str, boards: &[&Measured], percent: impl Fn(&Figures) -> Option<f64>) -> Result<()> {
    let row = |(nth, scene): (usize, &Scene)| {
        let values = boards.iter().map(|measured| percent(measured.scenes[nth].as_ref()?));
        (scene.name(), values.collect::<Vec<Option<f64>>>())
    };
    // The first row is the lowest.
    let mut rows: Vec<_> = Scene::ALL.iter().enumerate().rev().map(row).collect();
    rows.retain(|(_, values)| values.iter().any(Option::is_some));
    let places = rows.len() + LEGEND_ROWS;
    let root = SVGBackend::new(file, NARROW).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(14)
        .x_label_area_size(44)
        .y_label_area_size(NAMES)
        .build_cartesian_2d(0.0..PERCENT_ROOM, (0..places - 1).into_segmented())?;
    let name = |place: &SegmentValue<usize>| match place {
        SegmentValue::CenterOf(place) => rows.get(*place).map_or(String::new(), |row| row.0.clone()),
        _ => String::new(),
    };
    chart
        .configure_mesh()
        // The labels give the values: grid lines would run through them.
        .disable_mesh()
        .x_desc(axis)
        .x_label_formatter(&|percent| match *percent {
            ..=100.0 => format!("{percent:.0} %"),
            _ => String::new(),
        })
        .y_labels(places)
        .y_label_formatter(&name)
        .draw()?;
    let height = chart.plotting_area().dim_in_pixel().1 as i32 / places as i32;
    let bar = (height - 6) / boards.len() as i32;
    for (nth, (measured, colour)) in boards.iter().zip(COLOURS).enumerate() {
        let above = 3 + bar * nth as i32;
        let values = rows.iter().map(|(_, values)| values[nth]).enumerate();
        let values = values.filter_map(|(place, value)| Some((place, value?)));
        let bars = values.clone().map(|(place, value)| {
            let [from, to] = [SegmentValue::Exact(place), SegmentValue::Exact(place + 1)];
            let mut bar_of_row = Rectangle::new([(0.0, from), (value, to)], colour.filled());
            bar_of_row.set_margin(above as u32, (height - above - bar) as u32, 0, 0);
            bar_of_row
        });
        chart
            .draw_series(bars)?
            .label(measured.board.name())
            .legend(move |(x, y)| Rectangle::new([(x, y - 5), (x + 14, y + 5)], colour.filled()));
        chart.draw_series(values.map(|(place, value)| {
            let offset = above + bar / 2 - height / 2 - 3;
            let label = Text::new(format!("{value:.1} %"), (4, offset), ("sans-serif", 11));
            EmptyElement::at((value, SegmentValue::CenterOf(place))) + label
        }))?;
    }
    draw_legend(&mut chart)?;
    Ok(root.present()?)
}

/// Draws the legend in the upper right corner.
fn draw_legend<'a, C: CoordTranslate>(chart: &mut ChartContext<'a, SVGBackend<'a>, C>) -> Result<()> {
    Ok(chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE)
        .border_style(BLACK.mix(0.3))
        .draw()?)
}
