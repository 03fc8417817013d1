//! A drawing as SVG text.

use super::layout::{Anchor, Drawing, Mark};

/// The file's contents.
#[must_use]
pub fn to_svg(drawing: &Drawing) -> String {
    let (width, height) = (drawing.width, drawing.height);
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
    );
    for mark in &drawing.marks {
        text += &match mark {
            Mark::Line { ends: [a, b], colour, width } => format!(
                "<line x1=\"{:.2}\" y1=\"{:.2}\" x2=\"{:.2}\" y2=\"{:.2}\" stroke=\"{}\" stroke-width=\"{width}\"/>\n",
                a.0,
                a.1,
                b.0,
                b.1,
                hex(*colour)
            ),
            Mark::Dot { at, colour, radius } => format!(
                "<circle cx=\"{:.2}\" cy=\"{:.2}\" r=\"{radius}\" fill=\"{}\"/>\n",
                at.0,
                at.1,
                hex(*colour)
            ),
            Mark::Text { at, anchor, colour, text } => {
                let anchor = match anchor {
                    Anchor::Start => "start",
                    Anchor::Middle => "middle",
                    Anchor::End => "end",
                };
                format!(
                    "<text x=\"{:.2}\" y=\"{:.2}\" text-anchor=\"{anchor}\" dominant-baseline=\"middle\" \
                     fill=\"{}\">{}</text>\n",
                    at.0,
                    at.1,
                    hex(*colour),
                    escaped(text)
                )
            }
        };
    }
    text + "</svg>\n"
}

fn hex([r, g, b]: [u8; 3]) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_become_elements_and_text_is_escaped() {
        let text = Mark::Text {
            at: (3.0, 4.0),
            anchor: Anchor::End,
            colour: [255, 0, 16],
            text: "a < b & c".to_owned(),
        };
        let line = Mark::Line { ends: [(0.0, 1.0), (2.0, 3.5)], colour: [0; 3], width: 2.0 };
        let svg = to_svg(&Drawing { width: 10.0, height: 20.0, marks: vec![line, text] });
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
        assert!(svg.contains("x2=\"2.00\" y2=\"3.50\" stroke=\"#000000\""), "{svg}");
        assert!(
            svg.contains("text-anchor=\"end\"") && svg.contains("#ff0010\">a &lt; b &amp; c</text>"),
            "{svg}"
        );
    }
}
