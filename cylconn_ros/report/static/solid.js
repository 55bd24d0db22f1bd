// Vector algebra, and round solids of flat faces.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const scaled = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const size = (a) => Math.hypot(a[0], a[1], a[2]);
const unit = (a) => scaled(a, 1 / (size(a) || 1));

// v rotated by the quaternion x, y, z, w.
function turn(q, v) {
  const u = [q[0], q[1], q[2]];
  const twice = scaled(cross(u, v), 2);
  return add(add(v, scaled(twice, q[3])), cross(u, twice));
}

// Faces of a tube along e1 from a to b: { points, normal, colour }. colour(side, piece) returns the name of a colour.
function tube(origin, [e1, e2, e3], a, b, radius, pieces, sides, angle, colour) {
  const faces = [];
  const rim = [];
  for (let k = 0; k <= sides; k++) {
    const phi = angle + (2 * Math.PI * k) / sides;
    rim.push(add(scaled(e2, Math.cos(phi)), scaled(e3, Math.sin(phi))));
  }
  for (let p = 0; p < pieces; p++) {
    const near = add(origin, scaled(e1, a + ((b - a) * p) / pieces));
    const far = add(origin, scaled(e1, a + ((b - a) * (p + 1)) / pieces));
    for (let k = 0; k < sides; k++) {
      const r0 = scaled(rim[k], radius), r1 = scaled(rim[k + 1], radius);
      faces.push({
        points: [add(near, r0), add(far, r0), add(far, r1), add(near, r1)],
        normal: unit(add(rim[k], rim[k + 1])),
        colour: colour(k, p),
      });
    }
  }
  return faces;
}

// Faces of a flat ring across e1, seen from the side `facing` (1: along e1).
function ring(origin, [e1, e2, e3], at, inner, outer, sides, facing, angle, colour) {
  const faces = [];
  const centre = add(origin, scaled(e1, at));
  const place = (phi, r) => add(centre, add(scaled(e2, r * Math.cos(phi)), scaled(e3, r * Math.sin(phi))));
  for (let k = 0; k < sides; k++) {
    const p0 = angle + (2 * Math.PI * k) / sides, p1 = angle + (2 * Math.PI * (k + 1)) / sides;
    faces.push({
      points: [place(p0, inner), place(p0, outer), place(p1, outer), place(p1, inner)],
      normal: scaled(e1, facing),
      colour: colour(k),
    });
  }
  return faces;
}

// Colour (#rrggbb) shaded by a light intensity from 0 to 1.
function lit(hex, light) {
  const value = parseInt(hex.slice(1), 16);
  const shade = (part) => Math.round(Math.min(255, part * (0.45 + 0.65 * light)));
  return `rgb(${shade(value >> 16)}, ${shade((value >> 8) & 255)}, ${shade(value & 255)})`;
}
