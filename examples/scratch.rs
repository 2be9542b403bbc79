use vrdp::num::*;
use vrdp::scene::*;
use vrdp::world::*;
fn main() {
    let dir = std::env::args().nth(1).unwrap();
    let mut tot = vec![];
    let mut names: Vec<_> = std::fs::read_dir(&dir).unwrap().map(|e| e.unwrap().path()).collect();
    names.sort();
    let over = |e: &serde_json::Value, k: &str| e[k].as_f64().unwrap();
    for p in names {
        if !p.join("truth.json").exists() {
            continue;
        }
        let t: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(p.join("truth.json")).unwrap()).unwrap();
        let row = &t["trajectory"][0];
        let n = t["objects"].as_array().unwrap().len();
        let objects: Vec<Object> = (0..n)
            .map(|i| {
                let o = &t["objects"][i];
                let r = 0.2;
                Object {
                    id: o["object_id"].as_u64().unwrap() as u32,
                    color: "".into(),
                    material: o["material"].as_str().unwrap().into(),
                    mass: Some(over(o, "mass")),
                    shape: match o["shape"].as_str().unwrap() {
                        "sphere" => Shape::Ball { radius: r },
                        "cube" => Shape::Square { half_side: r },
                        _ => Shape::Disc { radius: r },
                    },
                }
            })
            .collect();
        let tracks = (0..n)
            .map(|i| Track {
                samples: vec![Sample {
                    frame: 0,
                    position: vec2(row[i][0].as_f64().unwrap(), row[i][1].as_f64().unwrap()),
                    yaw: Some(row[i][2].as_f64().unwrap()),
                }],
            })
            .collect();
        let nf = t["trajectory"].as_array().unwrap().len();
        let s = Scene {
            name: "".into(),
            setup: None,
            world: WorldKind::Clevrer,
            fps: 25.0,
            times: (0..nf).map(|f| f as f64 * 0.04).collect(),
            camera: None,
            table: None,
            noise_sigma: None,
            objects,
            tracks,
        };
        let mut m = Preset::named("clevrer").unwrap().model(&s);
        for (i, b) in m.bodies.iter_mut().enumerate() {
            b.start.state.velocity = vec2(row[i][3].as_f64().unwrap(), row[i][4].as_f64().unwrap());
            b.start.state.spin = row[i][5].as_f64().unwrap();
        }
        let t0 = std::time::Instant::now();
        let mut tr = trace(&m, &s.times);
        for _ in 0..20 {
            tr = trace(&m, &s.times);
        }
        let us = t0.elapsed().as_secs_f64() * 1e6 / 20.0 * 128.0 / nf as f64;
        let flat: Vec<Jet> = m.flatten().into_iter().map(Jet::constant).collect();
        let t0 = std::time::Instant::now();
        for _ in 0..5 {
            simulate(&m, &flat, &s.times, &Limits::default());
        }
        let uj = t0.elapsed().as_secs_f64() * 1e6 / 5.0 * 128.0 / nf as f64;
        let mut e = vec![];
        let mut pre = vec![];
        let first =
            tr.events.iter().filter(|e| e.kind == EventKind::Collision).map(|e| e.time).fold(1e9, f64::min);
        for f in 0..nf {
            for i in 0..n {
                let q = tr.states[f][i].unwrap();
                let r = &t["trajectory"][f][i];
                let d = (q.position - vec2(r[0].as_f64().unwrap(), r[1].as_f64().unwrap())).norm();
                e.push(d * d);
                if s.times[f] < first {
                    pre.push(d)
                }
            }
        }
        let rm = (e.iter().sum::<f64>() / e.len() as f64).sqrt();
        tot.push(rm);
        let c: Vec<_> = tr
            .events
            .iter()
            .filter(|e| e.kind == EventKind::Collision)
            .map(|e| ((e.time * 25.0).ceil() as i32, e.objects.clone()))
            .collect();
        let tc: Vec<_> = t["collisions"]
            .as_array()
            .unwrap()
            .iter()
            .map(|c| (c["frame_id"].as_i64().unwrap(), c["object_ids"].to_string()))
            .collect();
        println!(
            "{} n {n} rmse {rm:.4} pre {:.5} {us:.0}us jet {uj:.0}us {c:?} {tc:?}",
            p.file_name().unwrap().to_str().unwrap(),
            pre.iter().cloned().fold(0.0, f64::max)
        );
    }
    tot.sort_by(f64::total_cmp);
    println!("median {}", tot[tot.len() / 2]);
}
