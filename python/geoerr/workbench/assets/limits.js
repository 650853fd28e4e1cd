// Limits that were typed are of the variable that they were typed for: those of another one would be other rows.
window.dash_clientside = Object.assign({}, window.dash_clientside, {
  limits: {
    emptied: (variable, before) => {
      const { no_update: kept } = window.dash_clientside;
      return variable === before ? [kept, kept, kept] : ["", "", variable];
    },
  },
});
