// SPDX-License-Identifier: GPL-3.0-or-later
// A choice at the end of each node that sets its parameters to a preset. It is not a part of the graph.
import { app } from "../../scripts/app.js";

app.registerExtension({
  name: "impasto.presets",
  beforeRegisterNodeDef(nodeType, nodeData) {
    const presets = nodeData.name.startsWith("Impasto_") && nodeData.input?.required?.frames_per_second?.[1]?.presets;
    if (!presets) return;
    const created = nodeType.prototype.onNodeCreated;
    nodeType.prototype.onNodeCreated = function (...given) {
      created?.apply(this, given);
      const choose = (name) => {
        for (const widget of this.widgets) if (widget.name in presets[name]) widget.value = presets[name][widget.name];
        this.setDirtyCanvas(true, true);
      };
      const options = { values: Object.keys(presets), serialize: false };
      this.addWidget("combo", "set to preset", "default", choose, options).serialize = false;
    };
  },
});
