//! The paper's evaluation as a picture: how many times as long as directly a transaction takes through one router.

use plotters::prelude::{
    BLACK, BLUE, ChartBuilder, Circle, Color, IntoDrawingArea, LineSeries, PathElement, RED, SVGBackend,
    WHITE,
};

use crate::paper::factors;

const BAUD: u32 = 19_200;
const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/paper.svg");
const REGISTERS: [u8; 11] = [1, 5, 10, 20, 30, 40, 50, 65, 80, 100, 125];

/// Draws lines by the formula and dots where it was measured, into [`FILE`].
pub(crate) fn draw() -> Result<(), Box<dyn std::error::Error>> {
    let measured: Vec<_> =
        REGISTERS.into_iter().map(|registers| (registers, factors(BAUD, registers))).collect();
    let area = SVGBackend::new(FILE, (800, 450)).into_drawing_area();
    area.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&area)
        .caption(
            format!(
                "Towards Multi-port Modbus Gateway: one router, {BAUD} baud 8E1. Lines: formula, dots: measured"
            ),
            ("sans-serif", 20),
        )
        .margin(15)
        .x_label_area_size(40)
        .y_label_area_size(55)
        .build_cartesian_2d(0.0..130.0, 0.9..2.2)?;
    let mesh = &mut chart.configure_mesh();
    mesh.x_desc("registers read, device turnaround 1 ms").y_desc("times the direct transaction").draw()?;
    let curves = [("store and forward", RED, 0), ("cut-through", BLUE, 1)];
    for (name, colour, which) in curves {
        let formula =
            measured.iter().map(|(registers, factors)| (f64::from(*registers), factors.formula[which]));
        let line = chart.draw_series(LineSeries::new(formula, &colour))?;
        line.label(name).legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 20, y)], colour));
        let points = measured.iter().map(|(registers, factors)| {
            Circle::new((f64::from(*registers), factors.measured[which]), 4, colour.filled())
        });
        chart.draw_series(points)?;
    }
    chart.configure_series_labels().background_style(WHITE).border_style(BLACK).draw()?;
    area.present()?;
    println!("{FILE}: lines: formula, dots: measured");
    Ok(())
}
