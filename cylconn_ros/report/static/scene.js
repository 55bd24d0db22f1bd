// 3-D view of shaft and sleeve at the time of the cursor.

class Scene {
  constructor(host, link) {
    this.link = link;
    this.parts = frame(host, "scene", "Shaft and sleeve", "", 300);
    this.parts.root.dataset.key = "scene";
    this.reading = element("span", "key");
    this.button = element("button", "", "follow");
    this.parts.header.append(this.reading, this.button);
    const { path, geometry } = link.run;
    let low = Infinity, high = -Infinity, force = 0;
    for (let k = 0; k < path.length.length; k++) {
      if (path.length[k] < low) low = path.length[k];
      if (path.length[k] > high) high = path.length[k];
      const f = Math.hypot(path.force[3 * k], path.force[3 * k + 1], path.force[3 * k + 2]);
      if (f > force) force = f;
    }
    if (!(low <= high)) [low, high] = [0, 0];
    this.force = force || 1;
    const { overlap, radius, stops } = geometry;
    const beyond = Math.max(0.8 * overlap, 3 * radius);
    this.slot = [(stops[0] ?? low) - beyond, (stops[1] ?? high) + beyond];
    this.link.place(link.run.begin);
    this.yaw = 0.7;
    this.pitch = 0.35;
    this.zoom = 1;
    this.near = Math.max(5 * overlap, 9 * radius, 2.6 * this.arm());
    this.far = Math.max(1.15 * (this.slot[1] - this.slot[0]), 2.6 * this.arm());
    this.setFollow(this.far > 2.5 * this.near);
    this.button.addEventListener("click", () => {
      this.setFollow(!this.follow);
      this.drawCursor();
    });
    this.drag();
  }

  setFollow(follow) {
    this.follow = follow;
    this.button.setAttribute("aria-pressed", String(follow));
    this.button.title = follow ? "the view follows the sleeve" : "the view shows the whole slot";
  }

  drag() {
    const { stage } = this.parts;
    let from = null;
    stage.addEventListener("pointerdown", (event) => {
      from = [event.clientX, event.clientY, this.yaw, this.pitch];
      stage.setPointerCapture(event.pointerId);
    });
    stage.addEventListener("pointermove", (event) => {
      if (!from) return;
      this.yaw = from[2] - (event.clientX - from[0]) * 0.01;
      this.pitch = Math.min(1.5, Math.max(-1.5, from[3] + (event.clientY - from[1]) * 0.01));
      this.drawCursor();
    });
    stage.addEventListener("pointerup", () => (from = null));
    stage.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom = Math.min(20, Math.max(0.2, this.zoom * Math.exp(-event.deltaY * 0.0015)));
      this.drawCursor();
    }, { passive: false });
  }

  // Distance of the mass centre of B from node b at the start.
  arm() {
    const { centre, length, y, z } = this.link.run.path;
    if (!centre || ![...centre.slice(0, 3), length[0], y[0], z[0]].every(Number.isFinite)) return 0;
    const q = this.row("axes", 4);
    const node = add(this.row("origin", 3), turn(q, [length[0], y[0], z[0]]));
    return size(subtract([...centre.slice(0, 3)], node));
  }

  // The row of a column with k numbers at the cursor; the only row if the column is constant.
  row(name, k) {
    const column = this.link.run.path[name];
    const at = column.length > k ? k * this.link.sample : 0;
    return [...column.slice(at, at + k)];
  }

  camera(target, axis) {
    const up = unit(this.link.run.geometry.up);
    let across = subtract(axis, scaled(up, dot(axis, up)));
    if (size(across) < 0.2) across = Math.abs(up[0]) < 0.9 ? cross(up, [1, 0, 0]) : cross(up, [0, 1, 0]);
    across = unit(across);
    const side = cross(across, up);
    // At yaw 0 the line of sight is perpendicular to the slot.
    const level = add(scaled(side, Math.cos(this.yaw)), scaled(across, Math.sin(this.yaw)));
    const back = unit(add(scaled(level, Math.cos(this.pitch)), scaled(up, Math.sin(this.pitch))));
    const right = unit(cross(up, back));
    const above = cross(back, right);
    const { clientWidth: width, clientHeight: height } = this.parts.stage;
    const extent = (this.follow ? this.near : this.far) / this.zoom;
    const scale = (0.92 * width) / extent, distance = 3 * extent;
    return {
      back, right, above, scale,
      project: (point) => {
        const d = subtract(point, target);
        const z = dot(d, back);
        const s = (scale * distance) / Math.max(distance - z, 0.05 * distance);
        return [width / 2 + s * dot(d, right), height / 2 - s * dot(d, above), z];
      },
    };
  }

  // Length of the pieces of the drawn shaft; short, since faces are sorted by the depth of their centres.
  piece() {
    return (this.follow ? this.near / this.zoom : this.far) / 60;
  }

  // Ends of the contact along the slot: around its middle, by the overlap at the cursor.
  ends(length) {
    const { path } = this.link.run, half = path.overlap[this.link.sample] / 2;
    const middle = length + path.middle[this.link.sample];
    return [middle - half, middle + half];
  }

  faces(origin, axes, length, y, z, angle) {
    const { radius, overlap, stops } = this.link.run.geometry;
    const sleeve = add(origin, add(scaled(axes[1], y), scaled(axes[2], z)));
    const inner = 1.02 * radius, outer = 1.75 * radius;
    const [a, b] = this.ends(length);
    const step = this.piece();
    const seen = this.follow ? 1.2 * this.near / this.zoom : Infinity;
    const from = Math.max(this.slot[0], length - seen), to = Math.min(this.slot[1], length + seen);
    const pieces = Math.max(4, Math.ceil((to - from) / step));
    const striped = (side) => (side < 3 ? "mark" : "sleeve");
    const plain = (name) => () => name;
    const faces = [
      ...tube(origin, axes, from, to, radius, pieces, 20, 0, plain("shaft")),
      ...ring(origin, axes, from, 0, radius, 20, -1, 0, plain("shaft")),
      ...ring(origin, axes, to, 0, radius, 20, 1, 0, plain("shaft")),
      ...tube(sleeve, axes, a, b, outer, 4, 36, angle, striped),
      ...ring(sleeve, axes, a, inner, outer, 36, -1, angle, striped),
      ...ring(sleeve, axes, b, inner, outer, 36, 1, angle, striped),
    ];
    const thick = 0.3 * radius;
    for (const [stop, facing] of [[stops[0], -1], [stops[1], 1]]) {
      if (stop === null) continue;
      const at = stop + (facing * overlap) / 2;
      const ends = facing < 0 ? [at - thick, at] : [at, at + thick];
      faces.push(...tube(origin, axes, ...ends, 1.5 * radius, 1, 24, 0, plain("collar")));
      faces.push(...ring(origin, axes, ends[0], radius, 1.5 * radius, 24, -1, 0, plain("collar")));
      faces.push(...ring(origin, axes, ends[1], radius, 1.5 * radius, 24, 1, 0, plain("collar")));
    }
    return faces;
  }

  // Dark rings on the shaft at round positions, which show the slide while the view follows the sleeve.
  graduation(camera, origin, axes, length) {
    const { radius } = this.link.run.geometry, [a, b] = this.ends(length);
    const reach = (this.follow ? this.near / this.zoom : this.far) * 0.9;
    const { values } = ticks(Math.max(this.slot[0], length - reach), Math.min(this.slot[1], length + reach), 12);
    const rim = Array.from({ length: 25 }, (_, k) => (2 * Math.PI * k) / 24)
      .map((phi) => add(scaled(axes[1], Math.cos(phi)), scaled(axes[2], Math.sin(phi))));
    return values.filter((at) => at < a || at > b).map((at) => {
      const centre = add(origin, scaled(axes[0], at));
      const place = (normal) => (dot(normal, camera.back) < 0 ? null : camera.project(add(centre, scaled(normal, radius))));
      const before = 1.05 * radius + 0.6 * this.piece() * Math.abs(dot(axes[0], camera.back));
      return { line: rim.map(place), depth: camera.project(centre)[2] + before };
    });
  }

  drawCursor() {
    const { run, sample, palette } = this.link;
    const { path } = run;
    const { clientWidth: width, clientHeight: height } = this.parts.stage;
    const context = prepare(this.parts.base, width, height);
    const origin = this.row("origin", 3), q = this.row("axes", 4);
    const axes = [turn(q, [1, 0, 0]), turn(q, [0, 1, 0]), turn(q, [0, 0, 1])];
    const length = path.length[sample], y = path.y[sample], z = path.z[sample];
    const regime = path.regime[sample];
    if (![...origin, ...q, length, y, z].every(Number.isFinite)) {
      this.reading.textContent = "no pose";
      return;
    }
    const node = add(origin, add(scaled(axes[0], length), add(scaled(axes[1], y), scaled(axes[2], z))));
    const middle = add(origin, scaled(axes[0], (this.slot[0] + this.slot[1]) / 2));
    const camera = this.camera(this.follow ? node : middle, axes[0]);
    const light = unit(add(camera.back, add(scaled(camera.above, 0.9), scaled(camera.right, -0.5))));
    const seen = this.faces(origin, axes, length, y, z, path.angle[sample])
      .filter((face) => dot(face.normal, camera.back) > -0.12)
      .map((face) => {
        const points = face.points.map(camera.project);
        return { points, depth: (points[0][2] + points[1][2] + points[2][2] + points[3][2]) / 4, face };
      })
      .concat(this.graduation(camera, origin, axes, length))
      .sort((a, b) => a.depth - b.depth);
    for (const { points, line, face } of seen) {
      context.beginPath();
      if (line) {
        line.forEach((point, k) => point && (line[k - 1] ? context.lineTo(...point.slice(0, 2)) : context.moveTo(...point.slice(0, 2))));
        context.strokeStyle = palette.mark;
        context.lineWidth = 1.2;
        context.stroke();
        continue;
      }
      context.fillStyle = context.strokeStyle = lit(palette[face.colour], Math.max(0, dot(face.normal, light)));
      for (const [px, py] of points) context.lineTo(px, py);
      context.closePath();
      context.fill();
      context.lineWidth = 0.8;
      context.stroke();
    }
    if (path.centre) this.centre(context, camera, this.row("centre", 3));
    this.arrow(context, camera, node, axes, regime);
    this.compass(context, camera, axes);
    const f = this.row("force", 3);
    this.reading.textContent = `l ${valueText(length)} m, |f| ${valueText(size(f))} N, ${["frictionless", "stick", "slip"][regime] ?? "?"}`;
  }

  centre(context, camera, place) {
    const [x, y] = camera.project(place);
    context.lineWidth = 1.2;
    context.strokeStyle = context.fillStyle = this.link.palette.ink;
    for (let k = 0; k < 4; k++) {
      context.beginPath();
      context.moveTo(x, y);
      context.arc(x, y, 5, (k * Math.PI) / 2, ((k + 1) * Math.PI) / 2);
      if (k % 2) {
        context.fillStyle = this.link.palette.panel;
      } else {
        context.fillStyle = this.link.palette.ink;
      }
      context.fill();
    }
    context.beginPath();
    context.arc(x, y, 5, 0, 2 * Math.PI);
    context.stroke();
  }

  // Arrow of the connector's force on B at node b; its length is proportional to the force.
  arrow(context, camera, node, axes, regime) {
    const { palette } = this.link;
    const f = this.row("force", 3);
    const force = add(scaled(axes[0], f[0]), add(scaled(axes[1], f[1]), scaled(axes[2], f[2])));
    const long = (0.32 * (this.follow ? this.near : this.far)) / this.zoom / this.force;
    const [x0, y0] = camera.project(node), [x1, y1] = camera.project(add(node, scaled(force, long)));
    const reach = Math.hypot(x1 - x0, y1 - y0);
    if (!(reach > 2)) return;
    const [dx, dy] = [(x1 - x0) / reach, (y1 - y0) / reach];
    const head = Math.min(10, reach);
    context.strokeStyle = context.fillStyle = palette[["none-strong", "stick-strong", "slip-strong"][regime] ?? "ink"];
    context.lineWidth = 3;
    context.beginPath();
    context.moveTo(x0, y0);
    context.lineTo(x1 - dx * head, y1 - dy * head);
    context.stroke();
    context.beginPath();
    context.moveTo(x1, y1);
    context.lineTo(x1 - dx * head - dy * head * 0.5, y1 - dy * head + dx * head * 0.5);
    context.lineTo(x1 - dx * head + dy * head * 0.5, y1 - dy * head - dx * head * 0.5);
    context.fill();
  }

  // Axes in a corner: e1 along the slot, e2, e3, and gravity.
  compass(context, camera, axes) {
    const { palette, run } = this.link;
    const { clientHeight: height } = this.parts.stage;
    const marks = [["e₁", axes[0], "blue"], ["e₂", axes[1], "green"], ["e₃", axes[2], "purple"],
      ["g", scaled(run.geometry.up, -1), "soft"]];
    context.lineWidth = 1.6;
    context.textAlign = "center";
    context.textBaseline = "middle";
    for (const [name, direction, colour] of marks) {
      const x = 38 + 24 * dot(direction, camera.right), y = height - 40 - 24 * dot(direction, camera.above);
      context.strokeStyle = context.fillStyle = palette[colour];
      context.beginPath();
      context.moveTo(38, height - 40);
      context.lineTo(x, y);
      context.stroke();
      context.fillText(name, 38 + (x - 38) * 1.35, height - 40 + (y - height + 40) * 1.35);
    }
  }

  draw() {}

  get values() {
    return [this.reading.textContent];
  }
}
