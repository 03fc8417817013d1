//! Scratch.
#![allow(clippy::all, clippy::pedantic, missing_docs, clippy::unwrap_used, clippy::print_stdout)]
use earthshine_gen::*;
fn main() {
    let d = GenOptions::default();
    let mut list: Vec<(&str, WorldKind, GenOptions)> =
        WorldKind::ALL.iter().map(|&k| (k.name(), k, d.clone())).collect();
    let t = |size: f32, n: Option<u64>, flatten| GenOptions {
        town_size_m: size,
        town_triangles: n,
        flatten,
        ..d.clone()
    };
    list.push(("town-flat", WorldKind::Town, t(160., None, true)));
    list.push(("town-1m", WorldKind::Town, t(160., Some(1_000_000), false)));
    list.push(("town-1m-flat", WorldKind::Town, t(160., Some(1_000_000), true)));
    list.push(("town-least-160", WorldKind::Town, t(160., Some(60_000), false)));
    list.push(("town-3m-160", WorldKind::Town, t(160., Some(3_000_000), false)));
    list.push(("town-10m-400", WorldKind::Town, t(400., Some(10_000_000), false)));
    list.push(("corridor-10km", WorldKind::Corridor, GenOptions { corridor_length_m: 10_000., ..d.clone() }));
    for (name, kind, o) in list {
        let s = std::time::Instant::now();
        match generate(kind, &o, &|_, _| {}) {
            Ok(g) => {
                println!(
                    "{name}: {} triangles, {} stored, {} instances, {} lights, {} materials, {} bytes, {:.1} ms",
                    g.triangles,
                    g.stored_triangles,
                    g.instances,
                    g.lights,
                    g.materials,
                    g.bytes.len(),
                    s.elapsed().as_secs_f64() * 1e3
                );
                if let Some(dir) = std::env::args().nth(1) {
                    if g.bytes.len() < 40_000_000 {
                        g.write(&std::path::Path::new(&dir).join(format!("{name}.glb"))).unwrap();
                    }
                }
            }
            Err(e) => println!("{name}: {e}"),
        }
    }
    use glam::Vec3;
    let big = generate(WorldKind::Town, &t(160., None, true), &|_, _| {}).unwrap().bytes;
    picture(&big, Vec3::new(90., 70., 110.), Vec3::new(0., 0., 0.), "/tmp/genout/a.ppm", 0.0);
    picture(&big, Vec3::new(2., 1.7, 44.), Vec3::new(-10., 4., 20.), "/tmp/genout/b.ppm", 0.0);
    picture(&big, Vec3::new(-20., 14., -4.), Vec3::new(-20., 0., -20.), "/tmp/genout/c.ppm", 0.0);
    let m = generate(WorldKind::Town, &t(160., Some(1_000_000), true), &|_, _| {}).unwrap().bytes;
    picture(&m, Vec3::new(50., 22., 50.), Vec3::new(15., 0., 15.), "/tmp/genout/d.ppm", 0.0);
    for c in [(-2, -2), (0, 0), (-1, -1), (1, 1), (-2, 1)] {
        let low = generate_town_cell(&GenOptions { town_triangles: Some(16), ..d.clone() }, c).triangles;
        let def = generate_town_cell(&d, c).triangles;
        let all = generate_town_cell(&GenOptions { town_triangles: Some(16 * 12_000_000), ..d.clone() }, c)
            .triangles;
        println!("cell {c:?}: least {low} default {def} most {all}");
    }
}
#[path = "../tests/reading/mod.rs"] mod reading;
pub fn picture(bytes: &[u8], eye: glam::Vec3, target: glam::Vec3, out: &str, ortho: f32) {
    use glam::*;
    let gltf = gltf::Gltf::from_slice_without_validation(bytes).unwrap();
    let bin = gltf.blob.clone().unwrap();
    let (w, h) = (1400usize, 900usize);
    let view = Mat4::from_quat(Quat::IDENTITY) * look(eye, target);
    let mut z = vec![f32::INFINITY; w * h]; let mut img = vec![[120u8, 150, 200]; w * h];
    let sun = Vec3::new(0.45, 0.72, 0.53).normalize_or_zero();
    fn look(e: Vec3, t: Vec3) -> Mat4 { let f=(t-e).normalize_or_zero(); let r=f.cross(Vec3::Y).try_normalize().unwrap_or(Vec3::X); let u=r.cross(f); Mat4::from_cols(Vec4::new(r.x,u.x,-f.x,0.),Vec4::new(r.y,u.y,-f.y,0.),Vec4::new(r.z,u.z,-f.z,0.),Vec4::new(-r.dot(e),-u.dot(e),f.dot(e),1.)) }
    for node in gltf.nodes() { let Some(mesh) = node.mesh() else { continue };
        let (t, _, _) = node.transform().decomposed(); let t = Vec3::from(t);
        for p in mesh.primitives() { let rd = p.reader(|_| Some(&bin));
            let pos: Vec<Vec3> = rd.read_positions().unwrap().map(|p| Vec3::from(p) + t).collect();
            let c = p.material().pbr_metallic_roughness().base_color_factor(); let e = p.material().emissive_factor();
            let idx: Vec<u32> = rd.read_indices().unwrap().into_u32().collect();
            for k in idx.chunks(3) { let q = [pos[k[0] as usize], pos[k[1] as usize], pos[k[2] as usize]];
                let n = (q[1]-q[0]).cross(q[2]-q[0]).normalize_or_zero();
                let facing = if ortho > 0.0 { n.dot(eye - target) } else { n.dot(eye - q[0]) };
                let mut s = 0.35 + 0.15*n.y + 0.9 * n.dot(sun).max(0.0); if e != [0.;3] { s = 3.0; }
                let mut col = [0u8;3]; for i in 0..3 { col[i] = ((c[i]*s).min(1.0).powf(0.4545)*255.) as u8; }
                if facing < 0.0 { col = [255, 0, 255]; }
                let v: Vec<Vec3> = q.iter().map(|&p| view.transform_point3(p)).collect();
                if ortho == 0.0 && v.iter().any(|p| p.z > -0.05) { continue; }
                let s: Vec<Vec3> = v.iter().map(|p| { let k = if ortho > 0.0 { h as f32 / ortho } else { 700.0 / -p.z }; Vec3::new(w as f32/2. + p.x*k, h as f32/2. - p.y*k, if ortho>0.0 {-p.z} else {1.0/p.z}) }).collect();
                let (x0,x1)=(s.iter().map(|p|p.x).fold(f32::MAX,f32::min).max(0.) as usize, s.iter().map(|p|p.x).fold(f32::MIN,f32::max).min(w as f32-1.).max(0.) as usize);
                let (y0,y1)=(s.iter().map(|p|p.y).fold(f32::MAX,f32::min).max(0.) as usize, s.iter().map(|p|p.y).fold(f32::MIN,f32::max).min(h as f32-1.).max(0.) as usize);
                let ar = (s[1]-s[0]).truncate().perp_dot((s[2]-s[0]).truncate()); if ar.abs()<1e-6 {continue;}
                for y in y0..=y1 { for x in x0..=x1 { let pt=Vec2::new(x as f32+0.5,y as f32+0.5);
                    let a=(s[1].truncate()-pt).perp_dot(s[2].truncate()-pt)/ar; let b=(s[2].truncate()-pt).perp_dot(s[0].truncate()-pt)/ar; let g=1.-a-b;
                    if a<0.||b<0.||g<0. {continue;} let d=a*s[0].z+b*s[1].z+g*s[2].z; let d = if ortho>0.0 {d} else {d};
                    if d<z[y*w+x] { z[y*w+x]=d; img[y*w+x]=col; } } } } } }
    let mut f = format!("P6 {w} {h} 255\n").into_bytes(); f.extend(img.iter().flatten()); std::fs::write(out, f).unwrap();
}
