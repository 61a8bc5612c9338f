% The five-layer case in the names and units of the simulator (cm, dB/m): transducer, grid and layers.
%
% `asked` has power [W], harmonics, n_radial and n_axial. Table 1 of Suomi et al. 2016; all attenuation is absorption,
% and what water absorbs is not counted as heat.
function [transducer, grid, layers] = hitu_case(asked)
  transducer = struct('f', 1.1e6, 'a1', 1.0, 'a2', 3.2, 'd', 6.26, 'P', asked.power);
  grid = struct('Z', 9.6, 'KK', asked.harmonics, 'JJ', asked.n_radial, 'NN', asked.n_axial);
  % start [cm], sound speed, density, attenuation at 1 MHz [dB/m], exponent, B/A
  table = [0.0, 1482, 1000, 0.217, 2.00, 5.0
           3.4, 1615, 1090, 35.0, 1.55, 7.9
           3.6, 1478, 950, 48.0, 1.20, 10.0
           4.6, 1547, 1050, 109.0, 1.10, 7.4
           5.6, 1584, 1060, 35.0, 1.00, 7.2];
  for ii = 1:rows(table)
    row = table(ii, :);
    layers(ii) = struct('z', row(1), 'c', row(2), 'rho', row(3), 'alpha', row(4), 'fraction', double(ii > 1), ...
                        'eta', row(5), 'beta', 1 + row(6) / 2);
  end
end
