// The parts of plotly.js that pages use; core has "scatter".
const Plotly = require("plotly.js/lib/core");

Plotly.register([
  require("plotly.js/lib/bar"),
  require("plotly.js/lib/heatmap"),
  require("plotly.js/lib/mesh3d"),
  require("plotly.js/lib/scatter3d"),
]);

module.exports = Plotly;
